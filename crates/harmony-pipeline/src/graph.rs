//! The work graph of the four object levels: what waits for what.
//!
//! ```text
//!              wall            furniture          ceiling           decoration
//! find         layout          layout             layout            furniture placed
//! inspect      its find        + wall inspected   + furniture insp. + ceiling inspected
//! each object  complete -> completed? -> mesh -> upright -> front; beside all others, across levels
//! place        prepared        + wall placed      + furniture pl.   + ceiling placed
//! ```
//!
//! An image editor completes the room's faces beside all of them: they need the layout alone.
//!
//! Two chains run beside each other: preparation, as early as what it needs is there, and placement in the paper's
//! order. Inspection goes level by level because ids are numbered across levels and relations name objects of earlier
//! ones. The list of decorations waits for the furniture to be placed: it asks what the photo shows and the
//! reconstruction does not.
//!
//! All this pays when somebody outside makes meshes or completes pictures. When this program does it itself, there is
//! nothing to wait for, and each level is looked for when the one before is placed: its questions then tell where
//! things stand (`docs/decisions/0015-work-graph.md`).
//!
//! Whatever the timing, the result is the same: answers depend on questions, questions on what is named above, and what
//! is gathered from chains is put in order of ids.

use std::sync::{Arc, Mutex, PoisonError};

use futures::future::join_all;
use harmony_calls::StopReason;
use harmony_scene::Level;
use tokio::sync::{oneshot, watch};

use crate::Phase;
use crate::before::{Before, Known};
use crate::ctx::{PhaseCtx, PhaseError};
use crate::phases::objects::{self, PreparedLevel};
use crate::state::SceneState;
use crate::steps::detect;
use crate::steps::surfaces::{self, Faces};

/// Whether a value has come.
#[derive(Debug, Clone)]
enum Coming<T> {
    Open,
    There(T),
    Never,
}

/// A value that comes once, or never; many can wait for it.
struct Slot<T>(watch::Sender<Coming<T>>);

impl<T: Clone> Slot<T> {
    fn new() -> Self {
        Self(watch::Sender::new(Coming::Open))
    }

    /// The value is there; the first one stays.
    fn set(&self, value: T) {
        self.close(Coming::There(value));
    }

    /// It will not come, if it is not there already.
    fn never(&self) {
        self.close(Coming::Never);
    }

    fn close(&self, value: Coming<T>) {
        self.0.send_if_modified(|slot| {
            let open = matches!(slot, Coming::Open);
            if open {
                *slot = value;
            }
            open
        });
    }

    /// Waits for the value; `None` when it will not come.
    async fn get(&self) -> Option<T> {
        let mut changes = self.0.subscribe();
        let found = changes.wait_for(|slot| !matches!(slot, Coming::Open)).await;
        match &*found.ok()? {
            Coming::There(value) => Some(value.clone()),
            Coming::Open | Coming::Never => None,
        }
    }
}

/// A prepared level on its way to placement; with the last one the room's faces as an image editor completed them.
type Delivery = Result<(PreparedLevel, Faces), PhaseError>;

/// The levels of one run.
pub struct Graph<'a> {
    /// One a level that is wanted, in order.
    ctxs: Vec<PhaseCtx<'a>>,
    /// After the layout.
    start: Arc<SceneState>,
    /// Whether levels are prepared before the ones before them are placed.
    ahead: bool,
    /// What is known of each level once it is inspected.
    known: Vec<Slot<Arc<Known>>>,
    /// The scene after each level.
    placed: Vec<Slot<Arc<SceneState>>>,
    senders: Mutex<Vec<Option<oneshot::Sender<Delivery>>>>,
    receivers: Mutex<Vec<Option<oneshot::Receiver<Delivery>>>>,
}

impl<'a> Graph<'a> {
    /// The graph of the first levels, one context each.
    pub fn new(ctxs: Vec<PhaseCtx<'a>>, start: Arc<SceneState>) -> Self {
        let somebody_makes = ctxs.first().is_some_and(|ctx| ctx.can().makes_shapes || ctx.can().draws);
        let (senders, receivers) = ctxs.iter().map(|_| oneshot::channel()).map(|(s, r)| (Some(s), Some(r))).unzip();
        Self {
            ahead: somebody_makes,
            start,
            known: ctxs.iter().map(|_| Slot::new()).collect(),
            placed: ctxs.iter().map(|_| Slot::new()).collect(),
            senders: Mutex::new(senders),
            receivers: Mutex::new(receivers),
            ctxs,
        }
    }

    /// The levels' phases, in order.
    pub fn phases(&self) -> impl Iterator<Item = Phase> + use<> {
        self.ctxs.iter().map(|ctx| ctx.phase).collect::<Vec<_>>().into_iter()
    }

    /// Prepares all levels; ends when every chain has ended, well or not.
    pub async fn prepare(&self) {
        join_all((0..self.ctxs.len()).map(|level| async move {
            let delivery = self.level(level).await;
            if delivery.is_err() {
                self.known[level].never();
            }
            let sender = self.senders.lock().unwrap_or_else(PoisonError::into_inner)[level].take();
            if let Some(sender) = sender {
                // When placement has ended before, nobody wants it.
                let _ = sender.send(delivery);
            }
        }))
        .await;
    }

    async fn level(&self, level: usize) -> Delivery {
        let faces = async {
            let is_last = Level::ALL[level] == Level::Decoration;
            if is_last { surfaces::completed(&self.ctxs[level], &self.start).await } else { Ok(Faces::new()) }
        };
        let (prepared, faces) = futures::join!(self.prepared(level), faces);
        Ok((prepared?, faces?))
    }

    async fn prepared(&self, level: usize) -> Result<PreparedLevel, PhaseError> {
        let (ctx, name) = (&self.ctxs[level], Level::ALL[level]);
        let state = self.looks_at(level).await?;
        ctx.step(&format!("looking for {} objects", name.stage()));
        let found = detect::find(ctx, name, &state).await?;
        let before = Before { found: self.waiting(level, &state).await?, state: Arc::clone(&state) };
        let inspected = objects::inspect(ctx, name, found, &before).await?;
        self.known[level].set(Arc::new(inspected.known(name)));
        objects::prepare(ctx, name, &state, inspected).await
    }

    /// The scene that a level's questions look at.
    async fn looks_at(&self, level: usize) -> Result<Arc<SceneState>, PhaseError> {
        let after = match (Level::ALL[level], self.ahead) {
            (Level::Wall, _) | (Level::Furniture | Level::Ceiling, true) => return Ok(Arc::clone(&self.start)),
            (Level::Decoration, true) => 1,
            (_, false) => level - 1,
        };
        self.placed[after].get().await.ok_or_else(|| PhaseError::abandoned(self.ctxs[level].phase))
    }

    /// Earlier levels that are not placed in the scene a level looks at.
    async fn waiting(&self, level: usize, state: &SceneState) -> Result<Vec<Arc<Known>>, PhaseError> {
        let mut waiting = Vec::new();
        if self.ahead {
            let first = if Level::ALL[level] == Level::Decoration { 2 } else { 0 };
            for known in &self.known[first..level] {
                waiting.push(known.get().await.ok_or_else(|| PhaseError::abandoned(self.ctxs[level].phase))?);
            }
        }
        debug_assert!(waiting.iter().all(|k| state.partial.placed.iter().all(|p| p.item.level != k.level)));
        Ok(waiting)
    }

    /// Waits until a level is prepared and places it.
    ///
    /// # Errors
    /// What its preparation or placement failed with.
    pub async fn place(&self, level: usize, mut state: SceneState) -> Result<SceneState, PhaseError> {
        let ctx = &self.ctxs[level];
        let receiver = self.receivers.lock().unwrap_or_else(PoisonError::into_inner)[level].take();
        let delivery = match receiver {
            Some(receiver) => receiver.await.ok(),
            None => None,
        };
        let (prepared, faces) = delivery.ok_or_else(|| PhaseError::abandoned(ctx.phase))??;
        state.edited.faces.extend(faces);
        let state = objects::place(ctx, Level::ALL[level], state, prepared).await?;
        self.placed[level].set(Arc::new(state.clone()));
        Ok(state)
    }

    /// Placement has ended, at its end or before: whoever waits for it need not wait any more, and what could only be
    /// thrown away is not begun.
    pub fn end(&self, failure: Option<&str>) {
        for slot in &self.placed {
            slot.never();
        }
        if let (Some(failure), Some(ctx)) = (failure, self.ctxs.first()) {
            ctx.calls.stop().close(StopReason::Failed(failure.to_owned()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_slot_gives_its_value_to_all_who_wait_and_nothing_when_it_never_comes() {
        let slot = Slot::new();
        let (a, b, ()) = futures::join!(slot.get(), slot.get(), async { slot.set(7) });
        assert_eq!((a, b), (Some(7), Some(7)));
        slot.never();
        slot.set(8);
        assert_eq!(slot.get().await, Some(7), "the first value stays");
        let empty: Slot<u8> = Slot::new();
        let (none, ()) = futures::join!(empty.get(), async { empty.never() });
        assert_eq!(none, None);
    }
}
