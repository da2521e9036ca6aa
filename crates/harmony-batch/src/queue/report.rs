//! What a set has come to: counts, causes, scenes, workers. Read-only.

use std::collections::BTreeMap;

use serde::Serialize;
use sqlx::any::AnyRow;

use super::Queue;
use crate::BatchError;

/// Jobs by state, and what they took.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[expect(missing_docs, reason = "states of a job")]
pub struct Counts {
    pub queued: i64,
    pub waiting: i64,
    pub running: i64,
    pub done: i64,
    pub failed: i64,
    pub cancelled: i64,
    /// Mean time that a finished scene took, all its turns, milliseconds.
    pub mean_busy_ms: f64,
    /// Mean of what a finished scene was paid for, US dollars.
    pub mean_paid_usd: f64,
    /// Calls that were made for all scenes.
    pub calls: i64,
    /// US dollars that the scenes' bills add up to (what a run that was killed lost is not on them).
    pub bills_usd: f64,
}

impl Counts {
    /// Scenes that have not ended.
    pub fn open(&self) -> i64 {
        self.queued + self.waiting + self.running
    }

    /// All scenes.
    pub fn all(&self) -> i64 {
        self.open() + self.done + self.failed + self.cancelled
    }
}

/// Scenes that failed, or wait for their next try, at one stage for one cause.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[expect(missing_docs, reason = "as in a job")]
pub struct CauseCount {
    pub stage: String,
    pub cause: String,
    pub failed: i64,
    pub waiting: i64,
    /// One of them.
    pub example: String,
}

/// The same by stage.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[expect(missing_docs, reason = "as in a job")]
pub struct StageCount {
    pub stage: String,
    pub failed: i64,
    pub waiting: i64,
}

impl StageCount {
    /// Adds causes up.
    pub fn of(causes: &[CauseCount]) -> Vec<Self> {
        let mut stages: BTreeMap<&str, (i64, i64)> = BTreeMap::new();
        for cause in causes {
            let entry = stages.entry(&cause.stage).or_default();
            entry.0 += cause.failed;
            entry.1 += cause.waiting;
        }
        stages.into_iter().map(|(stage, (failed, waiting))| Self { stage: stage.to_owned(), failed, waiting }).collect()
    }
}

/// A scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[expect(missing_docs, reason = "as in a job")]
pub struct SceneRow {
    pub id: i64,
    pub scene: String,
    pub photo: String,
    pub state: String,
    pub priority: i64,
    pub attempts: i64,
    pub losses: i64,
    pub ends: i64,
    pub stage: String,
    pub cause: String,
    pub message: String,
    pub worker: String,
    pub paid_usd: f64,
    pub bill_usd: Option<f64>,
    pub calls: i64,
    pub busy_ms: i64,
    pub started: i64,
    pub ended: i64,
}

/// A worker that was heard of.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[expect(missing_docs, reason = "plain facts")]
pub struct WorkerRow {
    pub name: String,
    pub host: String,
    pub pid: i64,
    pub slots: i64,
    pub busy: i64,
    /// Milliseconds since it was last heard of.
    pub silent_ms: i64,
}

const SCENE: &str = "id, scene, photo, state, priority, attempts, losses, ends, stage, cause, message, worker, paid_usd, \
                     bill_usd, calls, busy_ms, started, ended";

impl Queue {
    /// Jobs of a set by state.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn counts(&self, set: i64) -> Result<Counts, BatchError> {
        let query = sqlx::query(
            "SELECT state, count(*) AS n, CAST(sum(busy_ms) AS BIGINT) AS busy, sum(paid_usd) AS paid,
                CAST(sum(calls) AS BIGINT) AS calls, CAST(COALESCE(sum(bill_usd), 0) AS DOUBLE PRECISION) AS bills
             FROM harmony_jobs WHERE set_id = $1 GROUP BY state",
        );
        let rows = query.bind(set).fetch_all(&self.pool).await.map_err(|e| self.fail(&e))?;
        let mut counts = Counts::default();
        for row in &rows {
            let state: String = self.read(row, "state")?;
            let n: i64 = self.read(row, "n")?;
            counts.calls += self.read::<i64>(row, "calls")?;
            counts.bills_usd += self.read::<f64>(row, "bills")?;
            match state.as_str() {
                "queued" => counts.queued = n,
                "waiting" => counts.waiting = n,
                "running" => counts.running = n,
                "done" => {
                    counts.done = n;
                    counts.mean_busy_ms = self.read::<i64>(row, "busy")? as f64 / n.max(1) as f64;
                    counts.mean_paid_usd = self.read::<f64>(row, "paid")? / n.max(1) as f64;
                }
                "failed" => counts.failed = n,
                _ => counts.cancelled += n,
            }
        }
        Ok(counts)
    }

    /// Whether a set has scenes that have not ended.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn is_open(&self, set: i64) -> Result<bool, BatchError> {
        let query = sqlx::query(
            "SELECT id FROM harmony_jobs WHERE set_id = $1 AND state IN ('queued', 'waiting', 'running') LIMIT 1",
        );
        Ok(query.bind(set).fetch_optional(&self.pool).await.map_err(|e| self.fail(&e))?.is_some())
    }

    /// Why scenes failed, most frequent first.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn causes(&self, set: i64) -> Result<Vec<CauseCount>, BatchError> {
        let query = sqlx::query(
            "SELECT stage, cause, CAST(sum(CASE WHEN state = 'failed' THEN 1 ELSE 0 END) AS BIGINT) AS failed,
                CAST(sum(CASE WHEN state = 'waiting' THEN 1 ELSE 0 END) AS BIGINT) AS waiting, min(scene) AS example
             FROM harmony_jobs WHERE set_id = $1 AND state IN ('failed', 'waiting') AND stage <> ''
             GROUP BY stage, cause ORDER BY count(*) DESC, stage, cause LIMIT 200",
        );
        let rows = query.bind(set).fetch_all(&self.pool).await.map_err(|e| self.fail(&e))?;
        rows.iter()
            .map(|row| {
                Ok(CauseCount {
                    stage: self.read(row, "stage")?,
                    cause: self.read(row, "cause")?,
                    failed: self.read(row, "failed")?,
                    waiting: self.read(row, "waiting")?,
                    example: self.read(row, "example")?,
                })
            })
            .collect()
    }

    /// Scenes of a set in a state (empty = all), the last to end first, at most so many. Of a state they are the end of an
    /// index, however many there are; of all they are sorted.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn scenes(&self, set: i64, state: &str, most: i64) -> Result<Vec<SceneRow>, BatchError> {
        let of_state = if state.is_empty() { "$2 = ''" } else { "state = $2" };
        let query = self.sql(&format!(
            "SELECT {SCENE} FROM harmony_jobs WHERE set_id = $1 AND {of_state} ORDER BY ended DESC, id LIMIT $3"
        ));
        let rows = sqlx::query(query).bind(set).bind(state).bind(most).fetch_all(&self.pool).await;
        rows.map_err(|e| self.fail(&e))?.iter().map(|row| self.scene_row(row)).collect()
    }

    /// The first and the last number of a set's scenes; `None` when it has none.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn numbers(&self, set: i64) -> Result<Option<(i64, i64)>, BatchError> {
        let query = sqlx::query(
            "SELECT COALESCE(min(id), 0) AS first, COALESCE(max(id), -1) AS last FROM harmony_jobs WHERE set_id = $1",
        );
        let row = query.bind(set).fetch_one(&self.pool).await.map_err(|e| self.fail(&e))?;
        let (first, last) = (self.read(&row, "first")?, self.read(&row, "last")?);
        Ok((first <= last).then_some((first, last)))
    }

    /// Scenes of a set whose numbers are in a range, both ends among them: a part of a set that would not fit into memory.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn scenes_between(&self, set: i64, first: i64, last: i64) -> Result<Vec<SceneRow>, BatchError> {
        // `+`: without it SQLite takes an index of the set and looks at all its scenes for each range.
        let query = self
            .sql(&format!("SELECT {SCENE} FROM harmony_jobs WHERE +set_id = $1 AND id BETWEEN $2 AND $3 ORDER BY id"));
        let rows = sqlx::query(query).bind(set).bind(first).bind(last).fetch_all(&self.pool).await;
        rows.map_err(|e| self.fail(&e))?.iter().map(|row| self.scene_row(row)).collect()
    }

    fn scene_row(&self, row: &AnyRow) -> Result<SceneRow, BatchError> {
        Ok(SceneRow {
            id: self.read(row, "id")?,
            scene: self.read(row, "scene")?,
            photo: self.read(row, "photo")?,
            state: self.read(row, "state")?,
            priority: self.read(row, "priority")?,
            attempts: self.read(row, "attempts")?,
            losses: self.read(row, "losses")?,
            ends: self.read(row, "ends")?,
            stage: self.read(row, "stage")?,
            cause: self.read(row, "cause")?,
            message: self.read(row, "message")?,
            worker: self.read(row, "worker")?,
            paid_usd: self.read(row, "paid_usd")?,
            bill_usd: self.read(row, "bill_usd")?,
            calls: self.read(row, "calls")?,
            busy_ms: self.read(row, "busy_ms")?,
            started: self.read(row, "started")?,
            ended: self.read(row, "ended")?,
        })
    }

    /// Scene names and photo hashes of a set.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn names(&self, set: i64) -> Result<BTreeMap<String, String>, BatchError> {
        let query = sqlx::query("SELECT scene, hash FROM harmony_jobs WHERE set_id = $1").bind(set);
        let rows = query.fetch_all(&self.pool).await.map_err(|e| self.fail(&e))?;
        rows.iter().map(|row| Ok((self.read(row, "scene")?, self.read(row, "hash")?))).collect()
    }

    /// Tells that a worker is there, and with how much.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn hello(&self, name: &str, host: &str, slots: i64, busy: i64) -> Result<(), BatchError> {
        let query = self.sql(
            "INSERT INTO harmony_workers (name, host, pid, slots, busy, seen) VALUES ($1, $2, $3, $4, $5, {now})
             ON CONFLICT (name) DO UPDATE SET busy = excluded.busy, seen = excluded.seen",
        );
        sqlx::query(query)
            .bind(name)
            .bind(host)
            .bind(i64::from(std::process::id()))
            .bind(slots)
            .bind(busy)
            .execute(&self.pool)
            .await
            .map_err(|e| self.fail(&e))?;
        Ok(())
    }

    /// A worker ends; those that were silent for a day are forgotten with it.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn goodbye(&self, name: &str) -> Result<(), BatchError> {
        let query = self.sql("DELETE FROM harmony_workers WHERE name = $1 OR seen < {now} - 86400000");
        sqlx::query(query).bind(name).execute(&self.pool).await.map_err(|e| self.fail(&e))?;
        Ok(())
    }

    /// Workers that were heard of within the last so many milliseconds.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn workers(&self, within_ms: i64) -> Result<Vec<WorkerRow>, BatchError> {
        let query = self.sql(
            "SELECT name, host, pid, slots, busy, {now} - seen AS silent FROM harmony_workers WHERE seen > {now} - $1
             ORDER BY host, pid",
        );
        let rows = sqlx::query(query).bind(within_ms).fetch_all(&self.pool).await.map_err(|e| self.fail(&e))?;
        rows.iter()
            .map(|row| {
                Ok(WorkerRow {
                    name: self.read(row, "name")?,
                    host: self.read(row, "host")?,
                    pid: self.read(row, "pid")?,
                    slots: self.read(row, "slots")?,
                    busy: self.read(row, "busy")?,
                    silent_ms: self.read(row, "silent")?,
                })
            })
            .collect()
    }
}
