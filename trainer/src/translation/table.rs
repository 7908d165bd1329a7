//! Methods side by side: every row trained with several seeds and one budget, and what came of it as a table.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use super::config::{Method, TranslationConfig};
use super::exam::{Exam, Marks};
use super::realness::Distance;
use super::training::{Trained, best_network, train};
use crate::backend::Backend;
use crate::config::{merge, read_table};
use crate::realness::Protocol;
use crate::realness::report::short;
use crate::seeds::mean_with_interval;
use crate::segmentation::Segmentation;
use crate::train::{Run, checkpoint};

/// What is compared: a TOML file.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TableConfig {
    /// Seeds that every row is trained with.
    pub seeds: Vec<u64>,
    /// What every row's config is told besides, keys as in a config.
    #[serde(default)]
    pub all: toml::Table,
    /// The rows.
    pub row: Vec<RowConfig>,
}

/// A row.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RowConfig {
    /// What it is called.
    pub name: String,
    /// The config that its runs are of, relative to the table's file; its seed is replaced.
    pub config: PathBuf,
    /// The name of a row above, whose runs these runs learn from, seed by seed.
    #[serde(default)]
    pub teacher: Option<String>,
}

/// The rows with their configs, on one budget.
#[derive(Clone, Debug)]
pub struct Table {
    seeds: Vec<u64>,
    rows: Vec<Row>,
}

/// A row with its config.
#[derive(Clone, Debug)]
struct Row {
    name: String,
    config: TranslationConfig,
    teacher: Option<String>,
}

impl Table {
    /// Reads a table's file and its rows' configs.
    ///
    /// Rows that differ in data, grid or budget are refused: their scores would say nothing about their methods. Those that learn from
    /// another row's answers have a budget of their own.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read table {}", path.display()))?;
        let table = toml::from_str(&text).with_context(|| format!("table {}", path.display()))?;
        let TableConfig { seeds, all, row: rows } = table;
        ensure!(!seeds.is_empty() && !rows.is_empty(), "table {}: no seeds or no rows", path.display());
        let row = |RowConfig { name, config, teacher }| {
            let mut table = read_table(&path.with_file_name(config))?;
            merge(&mut table, all.clone());
            let config = TranslationConfig::from_table(table).with_context(|| format!("row {name}"))?;
            Ok(Row { name, config, teacher })
        };
        let rows: Vec<_> = rows.into_iter().map(row).collect::<Result<_>>()?;
        let first = &rows[0];
        let expected = first.data()?;
        for (i, row) in rows.iter().enumerate() {
            let (name, found) = (&row.name, row.data()?);
            ensure!(found == expected, "row {name} differs in data from {}:\n{found}\n{expected}", first.name);
            match &row.teacher {
                None => ensure!(
                    row.budget() == first.budget(),
                    "row {name} differs in budget from {}: {}, {}",
                    first.name,
                    row.budget(),
                    first.budget()
                ),
                Some(teacher) => {
                    ensure!(rows[..i].iter().any(|row| row.name == *teacher), "row {name}: no row above is {teacher}");
                }
            }
        }
        Ok(Self { seeds, rows })
    }

    /// The same table, its steps computed by another backend.
    #[must_use]
    pub fn with_backend(mut self, backend: Backend) -> Self {
        self.rows.iter_mut().for_each(|row| row.config.backend = backend);
        self
    }

    /// Trains what has not ended yet, each run in a folder of its own under `out`, scores every run's best network on the test scans, leaves
    /// a picture of their answers, `answers.png`, and returns the table.
    ///
    /// Scores are those of [`crate::realness`], whose features are of the `segmentation` network; without one, of [`super::realness`].
    pub fn run(&self, data: &Path, out: &Path, segmentation: Option<&Segmentation>) -> Result<String> {
        let by = segmentation.map(|network| (network, Protocol::Realbeam));
        let exam = Exam::new(&self.rows[0].config, data, by)?;
        let mut columns: Vec<Column> = self.rows.iter().map(|row| Column { name: &row.name, marks: vec![] }).collect();
        let mut pictured = vec![];
        let folder = |name: &str, seed: u64| out.join(folder_name(name)).join(format!("seed-{seed}"));
        // Seed by seed, so that a table that is not finished yet has all its rows.
        for &seed in &self.seeds {
            for (Row { name, config, teacher }, column) in self.rows.iter().zip(&mut columns) {
                let config = TranslationConfig { seed, ..config.clone() };
                let taught = config.with_teacher(teacher.as_ref().map(|teacher| folder(teacher, seed)));
                let network = taught.and_then(|config| run(&config, data, folder(name, seed)));
                let network = network.with_context(|| format!("row {name}, seed {seed}"))?;
                let answers = exam.answers(&network);
                column.marks.push(exam.marks(&network, &answers)?);
                if pictured.len() < self.rows.len() {
                    pictured.extend(answers.into_iter().next());
                }
            }
        }
        let names = self.rows.iter().map(|row| row.name.as_str());
        let answers: Vec<_> = names.zip(&pictured).map(|(name, answer)| (answer, name)).collect();
        lidar::formats::write_atomically(&out.join("answers.png"), &exam.picture(&answers)?)?;
        let [elsewhere, twins] = print(&exam, &columns)?;
        let mut text = elsewhere;
        let seeds = match self.seeds.len() {
            1 => "One seed".to_owned(),
            seeds => format!("Mean of {seeds} seeds ± half of its 95 % interval (Student's t)"),
        };
        write!(
            text,
            "\n{seeds}, and the share of the gap between simulation and other real\n\
             scans that is closed, where these are nearer; {}. ",
            self.rows[0].budget()
        )?;
        for row in &self.rows {
            if let Some(teacher) = &row.teacher {
                let how = match row.config.method {
                    Method::Distil => format!("learned from what {teacher} answers"),
                    _ => format!("began with what {teacher} had learned"),
                };
                write!(text, "{} {how}, in {}. ", row.name, row.budget())?;
            }
        }
        write!(text, "{}\n\n{twins}", exam.says())?;
        Ok(text)
    }
}

impl Row {
    /// What is learned from, and on which grid.
    fn data(&self) -> Result<String> {
        let c = &self.config;
        let (simulated, real) = (toml::to_string(&c.simulated)?, toml::to_string(&c.real)?);
        Ok(format!(
            "{:?} columns of {:?}, own vehicle: {}, attenuation: {:?}\n{simulated}{real}",
            c.columns, c.sensor, c.own_vehicle, c.attenuation_per_m
        ))
    }

    /// How much is learned.
    fn budget(&self) -> String {
        let s = &self.config.schedule;
        let cut = match self.config.columns {
            Some(columns) if columns == s.crop_columns => format!("whole turns of {columns} columns"),
            _ => format!("cut-outs of {} columns", s.crop_columns),
        };
        format!("{} steps of {} {cut}", s.steps, s.batch)
    }
}

/// The scores of one run's best network on the test scans, beside the simulation and other real scans, by every metric of a protocol.
pub fn evaluate(config: &TranslationConfig, run: &Path, data: &Path, by: (&Segmentation, Protocol)) -> Result<String> {
    let exam = Exam::new(config, data, Some(by))?;
    let network = best_network(config, run)?;
    let marks = exam.marks(&network, &exam.answers(&network))?;
    let [elsewhere, twins] = print(&exam, &[Column { name: &config.name, marks: vec![marks] }])?;
    Ok(format!("{elsewhere}\n{}\n\n{twins}", exam.says()))
}

/// A row's scores, seed by seed, as a column.
struct Column<'t> {
    name: &'t str,
    marks: Vec<Marks>,
}

/// Metrics in rows, methods in columns: against real scans of other places, and in the same places.
fn print(exam: &Exam<'_>, columns: &[Column<'_>]) -> Result<[String; 2]> {
    let (simulation, floor) = (exam.of_simulation()?, exam.floor()?);
    let part = |of: fn(&Marks) -> &[Distance], best: &str| lines(of(&simulation), (of(&floor), best), columns, of);
    Ok([part(|marks| &marks.elsewhere, "real, another drive")?, part(|marks| &marks.twins, "real itself")?])
}

/// One part of it; the floor, which may lack metrics at the end, has a column of its own.
fn lines(
    simulation: &[Distance],
    (floor, best): (&[Distance], &str),
    columns: &[Column<'_>],
    of: fn(&Marks) -> &[Distance],
) -> Result<String> {
    let mut out = String::from("| | simulation |");
    for column in columns {
        write!(out, " {} |", column.name)?;
    }
    writeln!(out, " {best} |\n|---|{}", "---|".repeat(columns.len() + 2))?;
    for (i, from) in simulation.iter().enumerate() {
        let unit = if from.unit.is_empty() { String::new() } else { format!(" ({})", from.unit) };
        write!(out, "| {}{unit} | {} |", from.metric, short(from.value))?;
        let to = floor.get(i).map(|d| d.value);
        for column in columns {
            let values: Vec<f64> = column.marks.iter().map(|marks| of(marks)[i].value).collect();
            write!(out, " {}", mean_with_interval(&values))?;
            // Where other real scans are no nearer than the simulation there is no gap.
            if let Some(to) = to.filter(|to| *to < from.value) {
                let mean = values.iter().sum::<f64>() / values.len() as f64;
                write!(out, " ({:.0} %)", 100.0 * (from.value - mean) / (from.value - to))?;
            }
            out += " |";
        }
        writeln!(out, " {} |", to.map_or_else(|| "–".into(), short))?;
    }
    Ok(out)
}

/// The best network of a run that has ended; trains it before if it has not, from where it was interrupted.
fn run(config: &TranslationConfig, data: &Path, out: PathBuf) -> Result<Trained> {
    let begun = out.exists() && checkpoint::newest(&out)?.is_some();
    if begun && out.join("scores.json").exists() {
        // The teacher is where the table is, which may have been moved.
        let own = |config: TranslationConfig| TranslationConfig { teacher: None, ..config }.to_toml();
        let before = own(TranslationConfig::read(&out.join("config.toml"))?)?;
        ensure!(before == own(config.clone())?, "{} is a run of another config", out.display());
        return best_network(config, &out);
    }
    tracing::info!(run = %out.display(), "training");
    let run = Run { out, data: data.into(), resume: begun, stop_after: None };
    train(config, &run)?;
    best_network(config, &run.out)
}

/// A row's name as that of a folder.
fn folder_name(name: &str) -> String {
    name.chars().map(|c| if c.is_alphanumeric() { c.to_ascii_lowercase() } else { '-' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_has_a_folder_of_its_own() {
        assert_eq!(folder_name("+ RS"), "--rs");
        assert_eq!(folder_name("CLS2R"), "cls2r");
    }
}
