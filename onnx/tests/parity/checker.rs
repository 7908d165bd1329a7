//! Python's `onnx.checker` with full check, in one process for all tests.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{LazyLock, Mutex};

/// Reads a length in bytes and the file; answers one line, `ok` or the complaint.
const PROGRAM: &str = "
import sys
try:
    import onnx
except ImportError as error:
    print('missing', error, flush=True)
    sys.exit()
print('ready', onnx.__version__, flush=True)
while line := sys.stdin.buffer.readline():
    try:
        onnx.checker.check_model(onnx.load_from_string(sys.stdin.buffer.read(int(line))), full_check=True)
        print('ok', flush=True)
    except Exception as error:
        print(' '.join(str(error).split()), flush=True)
";

struct Checker {
    _process: Child,
    files: ChildStdin,
    answers: BufReader<ChildStdout>,
}

impl Checker {
    fn start() -> Option<Self> {
        let python = std::env::var("REALBEAM_PYTHON").unwrap_or_else(|_| "python3".into());
        let spawned = Command::new(&python).args(["-c", PROGRAM]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
        let started = spawned.map_err(|error| error.to_string()).and_then(|mut process| {
            let files = process.stdin.take().ok_or("no stdin")?;
            let mut answers = BufReader::new(process.stdout.take().ok_or("no stdout")?);
            let mut greeting = String::new();
            answers.read_line(&mut greeting).map_err(|error| error.to_string())?;
            if greeting.starts_with("ready") { Ok(Self { _process: process, files, answers }) } else { Err(greeting) }
        });
        match started {
            Ok(checker) => Some(checker),
            Err(problem) => {
                let note = format!(
                    "{python} cannot import onnx ({}); set REALBEAM_PYTHON or pip install onnx",
                    problem.trim()
                );
                assert!(std::env::var("CI").as_deref() != Ok("true"), "{note}");
                eprintln!("SKIPPED onnx.checker: {note}");
                None
            }
        }
    }

    fn verdict(&mut self, file: &[u8]) -> String {
        writeln!(self.files, "{}", file.len()).unwrap();
        self.files.write_all(file).unwrap();
        self.files.flush().unwrap();
        let mut answer = String::new();
        self.answers.read_line(&mut answer).unwrap();
        answer.trim().to_owned()
    }
}

/// What `onnx.checker` says of a file: `ok` or its complaint; nothing where Python has no `onnx`.
pub(crate) fn verdict(file: &[u8]) -> Option<String> {
    static CHECKER: LazyLock<Mutex<Option<Checker>>> = LazyLock::new(|| Mutex::new(Checker::start()));
    CHECKER.lock().unwrap().as_mut().map(|checker| checker.verdict(file))
}

#[test]
fn the_checker_complains_of_a_damaged_file() {
    let file = crate::comparison::export_of_a_sum();
    let Some(intact) = verdict(&file) else { return };
    assert_eq!(intact, "ok");
    let mut damaged = file;
    for start in 0..damaged.len() - 3 {
        if &damaged[start..start + 3] == b"Add" {
            damaged[start..start + 3].copy_from_slice(b"Axx");
        }
    }
    assert!(verdict(&damaged).is_some_and(|verdict| verdict.contains("Axx")));
}
