//! Budgets: money, calls and minutes, of the whole run and of each role.
//!
//! Money, calls and a role's minutes count for the run *folder*: what earlier starts spent is read from the records,
//! so that running again in a loop never spends more. The run's minutes count for each start.
//! A try is counted before it is made, with what it is expected to cost, so that calls beside each other don't
//! overshoot together; what it really cost replaces the expectation when it is over.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use harmony_roles::Role;
use serde::{Deserialize, Serialize};

/// What happens when a budget is reached.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WhenReached {
    /// The run stops; what was obtained is kept, and the same command goes on once the budget is raised.
    #[default]
    Stop,
    /// This program answers itself from then on, with a warning on everything it does so.
    Offline,
}

/// Budget of one role.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RoleBudget {
    /// US dollars.
    pub usd: Option<f64>,
    /// Times that somebody outside is asked, second tries included.
    pub calls: Option<usize>,
    /// Minutes that this role's calls take, added up.
    pub minutes: Option<f64>,
}

/// `[budget]` of the configuration.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Budget {
    /// US dollars for the run folder.
    pub usd: Option<f64>,
    /// Times that somebody outside is asked, second tries included.
    pub calls: Option<usize>,
    /// Minutes of one start: its deadline.
    pub minutes: Option<f64>,
    /// Seconds that calls in flight are awaited when the run stops before its end; they are paid.
    pub grace_seconds: Option<f64>,
    /// What happens when a budget is reached.
    pub when_reached: WhenReached,
    /// By role.
    pub roles: BTreeMap<Role, RoleBudget>,
}

/// Seconds that calls in flight are awaited, where nothing is configured: twice a mesh.
const GRACE_SECONDS: f64 = 120.0;

impl Budget {
    /// How long calls in flight are awaited when the run stops before its end.
    pub fn grace(&self) -> Duration {
        Duration::from_secs_f64(self.grace_seconds.unwrap_or(GRACE_SECONDS).clamp(0.0, 86_400.0))
    }

    /// Whether there is any limit.
    pub fn is_unlimited(&self) -> bool {
        let none = |r: &RoleBudget| r.usd.is_none() && r.calls.is_none() && r.minutes.is_none();
        self.usd.is_none() && self.calls.is_none() && self.minutes.is_none() && self.roles.values().all(none)
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// A sentence that names the field, its value and what is allowed.
    pub fn check(&self) -> Result<(), String> {
        let sound = |name: String, value: Option<f64>| match value {
            Some(v) if !(0.0..=525_600.0).contains(&v) => Err(format!("{name} is {v}; allowed is 0 to 525600")),
            _ => Ok(()),
        };
        sound("budget.usd".into(), self.usd)?;
        sound("budget.minutes".into(), self.minutes)?;
        sound("budget.grace_seconds".into(), self.grace_seconds)?;
        for (role, b) in &self.roles {
            sound(format!("budget.roles.{}.usd", role.folder()), b.usd)?;
            sound(format!("budget.roles.{}.minutes", role.folder()), b.minutes)?;
        }
        Ok(())
    }
}

/// What was spent.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Spent {
    /// US dollars, where known.
    pub usd: f64,
    /// Times that somebody outside was asked.
    pub calls: usize,
    /// Time of their calls, added up.
    pub time: Duration,
    /// US dollars that calls in flight are expected to cost.
    pub expected_usd: f64,
    /// Of the calls, those that are over.
    pub over: usize,
}

impl Spent {
    /// Adds what is over.
    pub fn add(&mut self, usd: Option<f64>, calls: usize, time: Duration) {
        self.usd += usd.unwrap_or(0.0);
        self.calls += calls;
        self.over += calls;
        self.time += time;
    }
}

/// Keeps count.
#[derive(Debug, Default)]
pub(crate) struct Purse {
    budget: Budget,
    roles: Mutex<BTreeMap<Role, Spent>>,
}

/// A try that is paid for: counted when it is made, settled when it is over.
#[derive(Debug)]
pub(crate) struct Reservation {
    purse: Arc<Purse>,
    role: Role,
    expected: f64,
    settled: bool,
}

impl Purse {
    pub fn new(budget: Budget, before: BTreeMap<Role, Spent>) -> Arc<Self> {
        Arc::new(Self { budget, roles: Mutex::new(before) })
    }

    pub fn budget(&self) -> &Budget {
        &self.budget
    }

    /// What was spent in all.
    pub fn spent(&self) -> Spent {
        Self::sum(&self.roles.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn sum(roles: &BTreeMap<Role, Spent>) -> Spent {
        roles.values().fold(Spent::default(), |sum, s| Spent {
            usd: sum.usd + s.usd,
            calls: sum.calls + s.calls,
            time: sum.time + s.time,
            expected_usd: sum.expected_usd + s.expected_usd,
            over: sum.over + s.over,
        })
    }

    /// Counts a try, or says which budget it would go beyond.
    ///
    /// `usual` is what a try is expected to cost where the role has no history.
    pub fn take(self: &Arc<Self>, role: Role, usual: Option<f64>) -> Result<Reservation, String> {
        let mut roles = self.roles.lock().unwrap_or_else(PoisonError::into_inner);
        let own = roles.get(&role).copied().unwrap_or_default();
        let mean = (own.over > 0 && own.usd > 0.0).then(|| own.usd / own.over as f64);
        let expected = mean.or(usual).unwrap_or(0.0);
        let all = Self::sum(&roles);
        let limit = self.budget.roles.get(&role).copied().unwrap_or_default();
        let money = |what: &str, spent: Spent, limit: Option<f64>| match limit {
            Some(limit) if spent.usd + spent.expected_usd + expected > limit + 1e-9 => Err(format!(
                "{:.2} US$ spent and {:.2} US$ in flight{what}; the next call, about {expected:.2} US$, would go \
                 beyond {limit:.2} US$",
                spent.usd, spent.expected_usd
            )),
            _ => Ok(()),
        };
        let calls = |what: &str, spent: Spent, limit: Option<usize>| match limit {
            Some(limit) if spent.calls >= limit => Err(format!("all {limit} calls{what} are made")),
            _ => Ok(()),
        };
        let of_role = format!(" for {}", role.folder());
        money("", all, self.budget.usd)?;
        money(&of_role, own, limit.usd)?;
        calls("", all, self.budget.calls)?;
        calls(&of_role, own, limit.calls)?;
        if let Some(minutes) = limit.minutes.filter(|m| own.time.as_secs_f64() >= m * 60.0) {
            return Err(format!("the {minutes} minutes{of_role} are used up"));
        }
        let entry = roles.entry(role).or_default();
        entry.calls += 1;
        entry.expected_usd += expected;
        Ok(Reservation { purse: Arc::clone(self), role, expected, settled: false })
    }
}

impl Reservation {
    /// The try is over.
    pub fn settle(mut self, cost: Option<f64>, time: Duration) {
        self.close(cost.unwrap_or(0.0), time);
    }

    fn close(&mut self, usd: f64, time: Duration) {
        self.settled = true;
        let mut roles = self.purse.roles.lock().unwrap_or_else(PoisonError::into_inner);
        let entry = roles.entry(self.role).or_default();
        entry.expected_usd = (entry.expected_usd - self.expected).max(0.0);
        entry.add(Some(usd), 0, time);
        entry.over += 1;
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        if !self.settled {
            // Let go of in flight: nobody knows whether it was paid, so it counts as paid.
            self.close(self.expected, Duration::ZERO);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn calls_beside_each_other_do_not_overshoot_together() {
        let purse = Purse::new(Budget { usd: Some(1.0), ..Budget::default() }, BTreeMap::new());
        let one = purse.take(Role::ImageEditor, Some(0.4)).unwrap();
        let two = purse.take(Role::ImageEditor, Some(0.4)).unwrap();
        let refused = purse.take(Role::ImageEditor, Some(0.4)).unwrap_err();
        assert!(refused.contains("1.00 US$"), "{refused}");
        one.settle(Some(0.1), Duration::from_secs(3));
        let three = purse.take(Role::ImageEditor, Some(0.4)).unwrap();
        drop(two);
        three.settle(None, Duration::ZERO);
        let spent = purse.spent();
        assert!((spent.usd - 0.5).abs() < 1e-9, "one let go of counts as paid: {spent:?}");
        assert_eq!((spent.calls, spent.expected_usd), (3, 0.0));
    }

    #[test]
    fn what_earlier_starts_spent_counts_and_roles_have_limits_of_their_own() {
        let meshes = RoleBudget { calls: Some(2), minutes: Some(1.0), ..RoleBudget::default() };
        let budget = Budget { calls: Some(10), roles: [(Role::MeshGenerator, meshes)].into(), ..Budget::default() };
        let mut before = Spent::default();
        before.add(Some(3.0), 1, Duration::from_secs(30));
        let purse = Purse::new(budget, [(Role::MeshGenerator, before)].into());
        purse.take(Role::MeshGenerator, None).unwrap().settle(None, Duration::from_secs(29));
        let refused = purse.take(Role::MeshGenerator, None).unwrap_err();
        assert!(refused.contains("mesh_generator") && refused.contains('2'), "{refused}");
        assert!(purse.take(Role::VisionLanguage, None).is_ok());
    }

    #[test]
    fn a_roles_minutes_are_those_of_its_calls() {
        let limit = RoleBudget { minutes: Some(1.0), ..RoleBudget::default() };
        let budget = Budget { roles: [(Role::MeshGenerator, limit)].into(), ..Budget::default() };
        let purse = Purse::new(budget, BTreeMap::new());
        purse.take(Role::MeshGenerator, None).unwrap().settle(None, Duration::from_secs(61));
        assert!(purse.take(Role::MeshGenerator, None).unwrap_err().contains("minutes"));
    }
}
