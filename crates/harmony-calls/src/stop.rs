//! Stopping a run cleanly: first nobody new is asked, then what is in flight is dropped.
//!
//! A stop is cooperative. Nothing is torn down from outside: every call looks here before it asks somebody, and while
//! it waits for a place, a rate limit or the next try. What is in flight is awaited, for it is paid; its answer is
//! recorded like any other. Only [`Stop::now`] lets go of it.

use harmony_roles::RoleError;
use tokio::sync::watch;

/// Why a run stops before its end.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StopReason {
    /// Somebody wants it so (Ctrl-C).
    Interrupted(String),
    /// Another part of the run failed.
    Failed(String),
    /// A budget or the run's deadline is reached.
    Budget(String),
}

impl StopReason {
    pub(crate) fn error(&self) -> RoleError {
        match self {
            Self::Interrupted(reason) | Self::Failed(reason) => RoleError::Interrupted { reason: reason.clone() },
            Self::Budget(reason) => RoleError::Budget { reason: reason.clone() },
        }
    }
}

#[derive(Debug, Clone, Default)]
struct State {
    /// Nobody new is asked.
    closed: Option<StopReason>,
    /// What is in flight is dropped too.
    now: bool,
}

/// The switch that all calls of a run look at.
#[derive(Debug)]
pub struct Stop(watch::Sender<State>);

impl Default for Stop {
    fn default() -> Self {
        Self(watch::Sender::new(State::default()))
    }
}

impl Stop {
    /// From now on nobody new is asked; what is in flight is awaited. The first reason stays.
    pub fn close(&self, reason: StopReason) {
        self.0.send_modify(|state| {
            state.closed.get_or_insert(reason);
        });
    }

    /// What is in flight is let go of, too; it may have been paid.
    pub fn now(&self, reason: StopReason) {
        self.0.send_modify(|state| {
            state.closed.get_or_insert(reason);
            state.now = true;
        });
    }

    /// Why nobody new is asked, if so.
    pub fn reason(&self) -> Option<StopReason> {
        self.0.borrow().closed.clone()
    }

    /// Fails when nobody new may be asked.
    pub(crate) fn check(&self) -> Result<(), RoleError> {
        self.reason().map_or(Ok(()), |reason| Err(reason.error()))
    }

    /// Waits until nobody new may be asked.
    pub(crate) async fn closed(&self) -> RoleError {
        self.when(|state| state.closed.is_some()).await
    }

    /// Waits until what is in flight is let go of.
    pub(crate) async fn dropped(&self) -> RoleError {
        self.when(|state| state.now).await
    }

    async fn when(&self, reached: impl Fn(&State) -> bool) -> RoleError {
        let mut changes = self.0.subscribe();
        // The sender lives as long as `self`, so this ends only when the state is reached.
        let reason = match changes.wait_for(|state| reached(state)).await {
            Ok(state) => state.closed.clone(),
            Err(_) => None,
        };
        reason.unwrap_or_else(|| StopReason::Interrupted("the run ended".to_owned())).error()
    }
}
