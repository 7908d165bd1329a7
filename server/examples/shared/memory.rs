//! Memory of processes.

/// Memory that a process has of the machine's, in bytes, page by page (`VmRSS` of `/proc/PID/status` lags behind).
pub(crate) fn resident_bytes(process: u32) -> Result<f64, Box<dyn std::error::Error>> {
    let maps = std::fs::read_to_string(format!("/proc/{process}/smaps_rollup"))?;
    let line = maps.lines().find_map(|line| line.strip_prefix("Rss:")).ok_or("no Rss")?;
    Ok(line.trim().trim_end_matches("kB").trim().parse::<f64>()? * 1024.0)
}
