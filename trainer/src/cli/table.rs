//! `realbeam-trainer table`: methods side by side.

use std::path::PathBuf;

use anyhow::Result;
use burn::tensor::Device;
use clap::Args;
use trainer::backend::Backend;
use trainer::segmentation::Segmentation;
use trainer::translation::table::Table;

#[derive(Debug, Args)]
pub(super) struct TableArgs {
    /// The table's rows and seeds (TOML).
    #[arg(long)]
    config: PathBuf,
    /// Folder that the configs' data paths are relative to.
    #[arg(long, default_value = ".")]
    data: PathBuf,
    /// Folder of the runs; those that have ended are not trained again, those that were interrupted go on.
    #[arg(long)]
    out: PathBuf,
    /// The segmentation network's folder, for every metric of `compare`; without, three quick ones are told.
    #[arg(long)]
    segmentation: Option<PathBuf>,
    /// What computes the steps, in the place of what the configs say.
    #[arg(long, value_enum)]
    backend: Option<Backend>,
}

impl TableArgs {
    /// Trains what is missing, and prints the table.
    pub(super) fn run(self) -> Result<()> {
        let table = Table::read(&self.config)?;
        let table = match self.backend {
            None => table,
            Some(backend) => table.with_backend(backend),
        };
        let load = |folder: &PathBuf| Segmentation::load(folder, &Device::flex());
        let segmentation = self.segmentation.as_ref().map(load).transpose()?;
        println!("{}", table.run(&self.data, &self.out, segmentation.as_ref())?);
        Ok(())
    }
}
