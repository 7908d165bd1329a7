//! `realbeam-trainer table`: methods side by side.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
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
}

impl TableArgs {
    /// Trains what is missing, and prints the table.
    pub(super) fn run(self) -> Result<()> {
        println!("{}", Table::read(&self.config)?.run(&self.data, &self.out)?);
        Ok(())
    }
}
