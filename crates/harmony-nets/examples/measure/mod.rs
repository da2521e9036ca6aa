//! Time and memory of this process.

use std::io::BufRead;
use std::time::{Duration, Instant};

/// Does `pass` once for each line on stdin and answers each with a line: wall-clock and processor time, peak memory.
/// `pass` returns the number of its results, so that none is left out.
pub fn turns(
    mut pass: impl FnMut() -> Result<usize, Box<dyn std::error::Error>>,
) -> Result<(), Box<dyn std::error::Error>> {
    for line in std::io::stdin().lock().lines() {
        line?;
        let (start, cpu) = (Instant::now(), cpu_time());
        if pass()? == 0 {
            return Err("a pass without results".into());
        }
        let (wall, cpu) = (start.elapsed().as_secs_f64(), cpu_time().saturating_sub(cpu).as_secs_f64());
        println!("harmony {wall:.3} s, {cpu:.2} CPU-s, {}", peak_memory());
    }
    Ok(())
}

/// CPU time of this process, where the system tells it.
fn cpu_time() -> Duration {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    let ticks = |i: usize| fields.get(i).and_then(|f| f.parse::<u64>().ok()).unwrap_or(0);
    Duration::from_millis((ticks(11) + ticks(12)) * 10)
}

/// The most memory that this process has held; mapped weights that were read count.
pub fn peak_memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let value = |key: &str| {
        let line = status.lines().find(|l| l.starts_with(key));
        line.and_then(|l| l.split_whitespace().nth(1)).and_then(|v| v.parse::<u64>().ok()).map_or(0, |k| k / 1024)
    };
    format!("peak {} MiB (now: {} own, {} mapped file)", value("VmHWM"), value("RssAnon"), value("RssFile"))
}
