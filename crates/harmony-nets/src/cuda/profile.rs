//! How long kernels take, one by one: for finding out where the time goes.

use std::collections::BTreeMap;

use cudarc::driver::result as driver;
use cudarc::driver::sys::{CUevent, CUevent_flags};

use super::Cuda;
use super::device::{Device, lock};
use crate::NetError;

/// Launches since a profile was begun: name, event before, event after.
#[derive(Debug, Default)]
pub(super) struct Profile(Vec<(String, CUevent, CUevent)>);

/// Launches of one kernel, or of one shape of product: name, how often, milliseconds of one.
pub type Launches = (String, usize, f64);

// SAFETY: events of the driver may be used from any thread.
unsafe impl Send for Profile {}

impl Device {
    /// Runs a launch, between two events when a profile is being made.
    pub(super) fn watched<T>(&self, name: impl FnOnce() -> String, launch: impl FnOnce() -> T) -> T {
        let mut profile = lock(&self.profile);
        let Some(profile) = profile.as_mut() else {
            drop(profile);
            return launch();
        };
        let event = || {
            let event = driver::event::create(CUevent_flags::CU_EVENT_DEFAULT).ok()?;
            // SAFETY: event and stream live.
            unsafe { driver::event::record(event, self.stream) }.ok().map(|()| event)
        };
        let before = event();
        let outcome = launch();
        if let (Some(before), Some(after)) = (before, event()) {
            profile.0.push((name(), before, after));
        }
        outcome
    }
}

impl Cuda {
    /// Runs something operation by operation and says what was launched: name, how often, milliseconds of one on
    /// average; what took longest in all first. The longest of several is left out, for the first launch of a kernel loads
    /// it. Events between launches add about a microsecond to each.
    ///
    /// # Errors
    /// What `body` says, and what the device says of work that failed.
    pub fn profiled<T>(&self, body: impl FnOnce() -> Result<T, NetError>) -> Result<(T, Vec<Launches>), NetError> {
        self.synchronize()?;
        *lock(&self.device.profile) = Some(Profile::default());
        let outcome = body();
        let profile = lock(&self.device.profile).take().unwrap_or_default();
        self.synchronize()?;
        let mut times = BTreeMap::<String, Vec<f64>>::new();
        for (name, before, after) in profile.0 {
            // SAFETY: all work has ended; the events are not used any more.
            unsafe {
                if let Ok(ms) = driver::event::elapsed(before, after) {
                    times.entry(name).or_default().push(f64::from(ms));
                }
                let _ = driver::event::destroy(before);
                let _ = driver::event::destroy(after);
            }
        }
        let middle = |(name, mut ms): (String, Vec<f64>)| {
            ms.sort_by(f64::total_cmp);
            let kept = &ms[..(ms.len() - 1).max(1)];
            (name, ms.len(), kept.iter().sum::<f64>() / kept.len() as f64)
        };
        let mut all: Vec<_> = times.into_iter().map(middle).collect();
        all.sort_by(|a, b| (b.1 as f64 * b.2).total_cmp(&(a.1 as f64 * a.2)));
        Ok((outcome?, all))
    }
}
