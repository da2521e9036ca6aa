//! The bill: calls, time, tokens and cost by role and phase.

use std::collections::BTreeMap;

use harmony_roles::{Role, Usage};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::CallName;
use crate::record::{CallSummary, Source, add_usage};

/// Where calls are booked that are about no single object.
const SHARED: &str = "(shared)";

/// Sums over some calls.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct BillLine {
    /// Calls.
    pub calls: usize,
    /// Of these, answered by this program alone.
    pub offline: usize,
    /// Of these, answered from a recording, or by the answer to another call.
    pub recorded: usize,
    /// Of these, answered by the offline player because the one that was asked failed.
    pub replaced: usize,
    /// Of these, tried and not answered when the run stopped.
    #[serde(default)]
    pub unanswered: usize,
    /// How often somebody was asked, second tries included.
    pub tries: usize,
    /// Sum of the latencies, milliseconds (calls run beside each other, so this is not wall clock).
    pub latency_ms: u64,
    /// Tokens and cost; a cost that is not known for some calls is the sum of the others.
    pub usage: Usage,
    /// Calls to players that are not offline and whose cost is not known.
    pub unpriced: usize,
}

/// The bill of a run, from its records: the same again however often the run is repeated.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Bill {
    /// Everything.
    pub total: BillLine,
    /// By role.
    pub by_role: BTreeMap<Role, BillLine>,
    /// By phase folder.
    pub by_phase: BTreeMap<String, BillLine>,
    /// By player and model, `player / model`.
    pub by_player: BTreeMap<String, BillLine>,
    /// By the object that a call is about; questions about many objects or the room are under `(shared)`.
    #[serde(default)]
    pub by_object: BTreeMap<String, BillLine>,
}

impl BillLine {
    fn add(&mut self, call: &CallSummary) {
        self.calls += 1;
        self.offline += usize::from(call.offline);
        self.recorded += usize::from(matches!(call.source, Source::Recording { .. } | Source::Shared { .. }));
        self.replaced += usize::from(matches!(call.source, Source::Replaced { .. }));
        self.unanswered += usize::from(call.source == Source::Unanswered);
        self.tries += call.tries;
        self.latency_ms = self.latency_ms.saturating_add(call.timing.latency_ms);
        self.usage = add_usage(self.usage, call.usage);
        self.unpriced += usize::from(!call.offline && call.tries > 0 && call.usage.cost_usd.is_none());
    }
}

impl Bill {
    /// As JSON without times: equal for equal answers.
    pub fn without_times(&self) -> Value {
        fn forget(value: &mut Value) {
            if let Value::Object(map) = value {
                map.retain(|key, _| key != "latency_ms");
                map.values_mut().for_each(forget);
            }
        }
        // Numbers, texts and maps by text: always JSON.
        let mut value = serde_json::to_value(self).unwrap_or_default();
        forget(&mut value);
        value
    }

    /// Adds up a log.
    pub fn of(log: &[CallSummary]) -> Self {
        let mut bill = Self::default();
        for call in log {
            bill.total.add(call);
            bill.by_role.entry(call.role).or_default().add(call);
            bill.by_phase.entry(call.phase.clone()).or_default().add(call);
            bill.by_player.entry(format!("{} / {}", call.player, call.model)).or_default().add(call);
            let object = CallName::new(&call.name).ok().and_then(|name| name.object());
            let object = object.map_or_else(|| SHARED.to_owned(), |id| id.to_string());
            bill.by_object.entry(object).or_default().add(call);
        }
        bill
    }
}
