//! Processor time.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// Ticks of `/proc` a second, on every Linux that there is.
const TICKS: f64 = 100.0;

/// What this process has taken, those threads of it included that have ended, in seconds.
pub(crate) fn taken_s() -> Option<f64> {
    of(Path::new("/proc/self")).map(|(_, seconds)| seconds)
}

/// What this process's threads have taken, in seconds, by their names.
pub(crate) fn taken_by_thread_s() -> std::io::Result<BTreeMap<String, f64>> {
    let mut taken = BTreeMap::new();
    for thread in fs::read_dir("/proc/self/task")? {
        // One may end meanwhile.
        if let Some((name, seconds)) = of(&thread?.path()) {
            *taken.entry(name).or_default() += seconds;
        }
    }
    Ok(taken)
}

/// Name and seconds of a process or thread, from its `stat`.
fn of(place: &Path) -> Option<(String, f64)> {
    let stat = fs::read_to_string(place.join("stat")).ok()?;
    let (name, rest) = stat.split_once('(')?.1.rsplit_once(')')?;
    // User and system time: fields 14 and 15 of proc(5), of which the first two are gone here.
    let ticks: f64 = rest.split_whitespace().skip(11).take(2).filter_map(|field| field.parse::<f64>().ok()).sum();
    Some((name.into(), ticks / TICKS))
}
