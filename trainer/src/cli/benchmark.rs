//! `benchmark-loop`: how often the closed loop finds what was hidden from it.

use std::path::PathBuf;

use anyhow::{Result, bail, ensure};
use clap::Args;
use hidden::{LIBRARY, UNKNOWN, even_sensor};
use trainer::benchmark::{Extent, Judgement, Row, Run, Selection, Suite, append, resume, run, table};

#[derive(Debug, Args)]
pub(crate) struct BenchmarkArgs {
    /// Suites to run; all of them if none is given.
    #[arg(long)]
    suite: Vec<Suite>,
    /// Sets for each name, pair, or name and size; twenty times as many without a defect.
    #[arg(long, default_value_t = 5)]
    seeds: u64,
    /// Only sets with the defect of this name.
    #[arg(long)]
    only: Option<String>,
    /// Sets at a time [default: one a processor].
    #[arg(long)]
    jobs: Option<usize>,
    /// File for a line of JSON a set.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Go on from the sets that OUT has already.
    #[arg(long, requires = "out")]
    resume: bool,
    /// Small sets: one frame in each of six streets, 16 rings of 256 columns.
    #[arg(long)]
    small: bool,
    /// Sets of so many rings, columns and frames, such as 64x2048x24.
    #[arg(long, value_parser = grid, conflicts_with = "small")]
    grid: Option<Extent>,
    /// A handful of small sets, to see that everything runs.
    #[arg(long, conflicts_with_all = ["suite", "seeds", "only", "grid"])]
    short: bool,
}

impl BenchmarkArgs {
    /// Runs the sets that are not in the file yet and prints the table of all.
    pub(crate) fn run(self) -> Result<()> {
        if let Some(only) = self.only.as_deref().filter(|only| !LIBRARY.contains(only) && !UNKNOWN.contains(only)) {
            bail!("--only {only}: no such defect; there are {}, {}", LIBRARY.join(", "), UNKNOWN.join(", "));
        }
        let suites = if self.suite.is_empty() { Suite::ALL.to_vec() } else { self.suite };
        let mut cases = if self.short {
            Selection::short()
        } else {
            Selection { suites, seeds: self.seeds, only: self.only }.cases()
        };
        let extent = if self.small || self.short { Extent::Small } else { self.grid.unwrap_or(Extent::Full) };
        if let Some(path) = self.out.as_ref().filter(|path| !self.resume && path.exists()) {
            bail!("{} exists already; --resume goes on from it", path.display());
        }
        let opened = self.out.as_deref().map(resume).transpose()?;
        let (mut file, mut rows) = opened.map_or_else(Default::default, |(file, rows)| (Some(file), rows));
        cases.retain(|case| rows.iter().all(|row: &Row| row.case != *case));

        let jobs = self.jobs.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
        ensure!(jobs > 0, "--jobs 0: nothing would run");
        let mut left = cases.len();
        run(&cases, Run { extent, jobs }, |row| {
            let judged = Judgement::of(&row);
            let right = if judged.right { "right" } else { "wrong" };
            let (suite, label) = (row.case.suite.name(), row.case.label());
            left -= 1;
            tracing::info!(
                "{suite}: {label} × {}: {right}, {}; {:.1} s; {left} left",
                row.case.size,
                judged.said,
                row.seconds
            );
            if let Some(file) = &mut file {
                append(file, &row)?;
            }
            rows.push(row);
            Ok(())
        })?;
        print!("{}", table(&rows));
        Ok(())
    }
}

/// `RINGSxCOLUMNSxFRAMES`.
fn grid(text: &str) -> Result<Extent> {
    let numbers: Vec<usize> = text.split('x').map(str::parse).collect::<Result<_, _>>().unwrap_or_default();
    let &[rings, columns, frames] = numbers.as_slice() else {
        bail!("RINGSxCOLUMNSxFRAMES, such as 64x2048x24");
    };
    ensure!(frames >= 6 && frames.is_multiple_of(2), "{frames} frames: two in each of three or more streets");
    even_sensor(rings, columns)?;
    Ok(Extent::Grid { rings, columns, scenes: frames / 2 })
}
