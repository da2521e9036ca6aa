//! What computing costs: processor time and memory, as Linux tells them.

use std::fs::read_to_string;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Ticks a second in `/proc`, whatever the kernel's own clock is.
const TICKS: f64 = 100.0;

/// Processor time of the whole process so far, seconds, user and system; `None` where there is no `/proc`.
pub fn processor_seconds() -> Option<f64> {
    let text = read_to_string("/proc/self/stat").ok()?;
    // The name in brackets may hold anything; fields 14 and 15 of the whole are 12 and 13 after it.
    let fields: Vec<&str> = text.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |i: usize| fields.get(i)?.parse::<f64>().ok();
    Some((ticks(11)? + ticks(12)?) / TICKS)
}

/// Processor time of this thread so far, seconds.
pub fn thread_seconds() -> Option<f64> {
    let text = read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(text.split_whitespace().next()?.parse::<f64>().ok()? / 1e9)
}

/// The most memory that the process has had resident so far, MiB.
pub fn peak_mib() -> Option<f64> {
    let text = read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok()? / 1024.0)
}

/// Seconds, by the wall clock and of the processor.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Seconds {
    /// By the wall clock.
    pub wall: f64,
    /// Of the processor, user and system; 0 where it cannot be told.
    pub processor: f64,
}

/// Adds up what some work costs that does not change threads.
#[derive(Debug, Default)]
pub struct Meter(Mutex<Seconds>);

impl Meter {
    /// Does some work and adds what it took.
    pub fn measured<T>(&self, work: impl FnOnce() -> T) -> T {
        let (begun, before) = (Instant::now(), thread_seconds());
        let done = work();
        let processor = thread_seconds().zip(before).map_or(0.0, |(after, before)| after - before);
        let mut sum = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        sum.wall += begun.elapsed().as_secs_f64();
        sum.processor += processor;
        done
    }

    /// The sum.
    pub fn total(&self) -> Seconds {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn work_costs_processor_time_and_waiting_does_not() {
        let (meter, idle) = (Meter::default(), Meter::default());
        let before = processor_seconds().unwrap();
        let sum = meter.measured(|| {
            let begun = Instant::now();
            let mut sum = 0_u64;
            while begun.elapsed().as_millis() < 80 {
                sum = sum.wrapping_mul(31).wrapping_add(std::hint::black_box(7));
            }
            sum
        });
        std::hint::black_box(sum);
        idle.measured(|| std::thread::sleep(std::time::Duration::from_millis(80)));
        let (worked, waited) = (meter.total(), idle.total());
        assert!(worked.wall >= 0.08 && worked.processor > 0.0 && worked.processor <= worked.wall, "{worked:?}");
        assert!(waited.wall >= 0.08 && waited.processor < worked.wall / 4.0, "{waited:?}");
        // Ticks are 10 ms.
        assert!(processor_seconds().unwrap() - before >= worked.processor - 0.02);
        assert!(peak_mib().unwrap() > 1.0);
    }
}
