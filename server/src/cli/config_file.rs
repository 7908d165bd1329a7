//! The configuration file: a flat TOML file whose keys are the names of a subcommand's options.
//!
//! Its values become the options' defaults, so that what an option is, means and may be is written once, at the option itself.

use std::fs;
use std::path::{Path, PathBuf};

use clap::{Arg, Command};
use thiserror::Error;
use toml::{Table, Value};

/// A configuration file that cannot be used.
#[derive(Debug, Error)]
#[error("configuration file {}: {problem}", path.display())]
pub(super) struct ConfigFileError {
    path: PathBuf,
    problem: Problem,
}

#[derive(Debug, Error)]
enum Problem {
    #[error("cannot be read: {0}")]
    Io(#[from] std::io::Error),
    #[error("{0}")]
    Toml(#[from] toml::de::Error),
    #[error("key `{key}` is unknown; there are {known}")]
    UnknownKey { key: String, known: String },
    #[error("key `{key}` is {found}, expected a text, a number, true, false, or a list of these")]
    Kind { key: String, found: &'static str },
    /// The words are clap's: they name the option, the value and what it may be.
    #[error("{0}")]
    Value(String),
}

/// The command with the file's values as defaults of a subcommand's options.
pub(super) fn as_defaults(command: Command, subcommand: &str, path: &Path) -> Result<Command, ConfigFileError> {
    let fail = |problem| ConfigFileError { path: path.into(), problem };
    let text = fs::read_to_string(path).map_err(|error| fail(error.into()))?;
    let table = text.parse().map_err(|error: toml::de::Error| fail(error.into()))?;
    with_table(command, subcommand, table).map_err(fail)
}

fn with_table(command: Command, subcommand: &str, table: Table) -> Result<Command, Problem> {
    let known: Vec<String> =
        command.find_subcommand(subcommand).into_iter().flat_map(Command::get_arguments).filter_map(key).collect();
    let mut defaults = Vec::new();
    for (key, value) in table {
        if !known.contains(&key) {
            return Err(Problem::UnknownKey { key, known: known.join(", ") });
        }
        let values = match value {
            Value::Array(values) => values.into_iter().map(|value| scalar(&key, value)).collect::<Result<_, _>>()?,
            value => vec![scalar(&key, value)?],
        };
        defaults.push((key, values));
    }
    let command = command.mut_subcommand(subcommand, |subcommand| {
        defaults.into_iter().fold(subcommand, |subcommand, (key, values)| {
            subcommand.mut_arg(key, |option| option.default_values(values))
        })
    });
    // Nothing but the defaults, so that what is wrong is the file's.
    let alone = [command.get_name(), subcommand];
    match command.clone().try_get_matches_from(alone) {
        Ok(_) => Ok(command),
        Err(error) => Err(Problem::Value(error.to_string())),
    }
}

/// The key of an option; the file itself has none.
fn key(option: &Arg) -> Option<String> {
    let id = option.get_id().as_str();
    (option.get_long().is_some() && id != super::serve::CONFIG).then(|| id.into())
}

fn scalar(key: &str, value: Value) -> Result<String, Problem> {
    let found = match value {
        Value::String(text) => return Ok(text),
        Value::Integer(number) => return Ok(number.to_string()),
        Value::Float(number) => return Ok(number.to_string()),
        Value::Boolean(flag) => return Ok(flag.to_string()),
        Value::Datetime(_) => "a date",
        Value::Array(_) => "a list of lists",
        Value::Table(_) => "a section",
    };
    Err(Problem::Kind { key: key.into(), found })
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;
    use crate::cli::Cli;
    use crate::cli::serve;

    /// The queue that `serve` runs with, given a file's text and the command line.
    fn queue(text: &str, arguments: &[&str]) -> Result<usize, Box<dyn std::error::Error>> {
        let command = with_table(Cli::command(), serve::NAME, text.parse()?)?;
        let matches = command.try_get_matches_from([&["realbeam-server", serve::NAME], arguments].concat())?;
        let queue = matches.subcommand_matches(serve::NAME).and_then(|matches| matches.get_one("queue"));
        Ok(*queue.ok_or("no queue")?)
    }

    fn problem(text: &str) -> String {
        queue(text, &[]).err().map(|error| error.to_string()).unwrap_or_default()
    }

    #[test]
    fn the_file_counts_before_the_default_and_the_command_line_before_the_file()
    -> Result<(), Box<dyn std::error::Error>> {
        assert_eq!(queue("", &[])?, 32);
        assert_eq!(queue("queue = 7", &[])?, 7);
        assert_eq!(queue("queue = 7", &["--queue=9"])?, 9);
        Ok(())
    }

    #[test]
    fn what_is_wrong_with_a_file_is_said_by_its_key() {
        let unknown = problem("quue = 7");
        assert!(unknown.starts_with("key `quue` is unknown; there are log_format, log_filter, models,"), "{unknown}");
        assert!(problem("config = 'other.toml'").starts_with("key `config` is unknown"), "a file names no other file");
        let workers = problem("workers = 0");
        assert!(workers.contains("invalid value '0' for '--workers <WORKERS>'"), "{workers}");
        assert!(problem("[queue]").contains("key `queue` is a section"));
        assert!(problem("queue = [[1]]").contains("key `queue` is a list of lists"));
        assert!(problem("queue = ").contains("TOML parse error at line 1"), "{}", problem("queue = "));
    }

    #[test]
    fn every_option_is_a_variable_and_says_what_it_does() -> Result<(), Box<dyn std::error::Error>> {
        let command = Cli::command();
        let serve = command.find_subcommand(serve::NAME).ok_or("no serve")?;
        let options: Vec<&Arg> = serve.get_arguments().filter(|option| option.get_id() != "help").collect();
        assert!(options.len() > 10);
        for option in options {
            assert!(option.get_env().is_some(), "{option} has no environment variable");
            assert!(option.get_help().is_some(), "{option} has no help");
        }
        Ok(())
    }
}
