//! Jobs: one a scene. Queued, claimed for a time, renewed, ended; lost ones put back; failed ones tried again later or
//! set aside.
//!
//! ```text
//! queued -> running -> done
//!              |  \--> waiting (a retry that is not due yet) -> queued
//!              |  \--> failed  (set aside: failed or lost too often; `retry` puts it back)
//!              |  \--> cancelled
//!              \-----> queued  (its worker was silent for longer than the lease, or gave it back)
//! ```
//! Rows are locked in one order everywhere: player, set, job.

use serde::Serialize;
use sqlx::{Any, Transaction};

use super::{Kind, Queue, SetRow, UNTOLD};
use crate::BatchError;

/// Longest wait before a retry.
const MAX_RETRY_MS: i64 = 3_600_000;

/// Longest message kept with a job, characters.
const MAX_MESSAGE: usize = 2000;

/// A scene to be queued.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct NewJob {
    /// Name of the scene in its set; unique there, and the name of its run folder.
    pub scene: String,
    /// Photo, relative to the set's folder.
    pub photo: String,
    /// Its content's hash.
    pub hash: String,
    /// Higher goes first; equal ones in the order of their coming.
    pub priority: i64,
}

/// A scene that was claimed.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "as in NewJob")]
pub struct Job {
    pub id: i64,
    pub scene: String,
    pub photo: String,
    pub hash: String,
    /// Grows with every claim: who has an old one changes nothing.
    pub token: i64,
    /// Times that it failed before.
    pub attempts: i64,
    /// Its set, as it was when the job was claimed.
    pub set: SetRow,
}

/// A job that a worker still holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "as in Job")]
pub struct Held {
    pub id: i64,
    pub token: i64,
    /// Somebody wants it stopped.
    pub cancel: bool,
}

/// How a job's turn ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Ended {
    /// The scene is there.
    Done,
    /// It failed: tried again later, or set aside.
    Failed {
        /// Phase, or `input`, `crash`, `time`, `budget`.
        stage: String,
        /// What failed, without what differs from scene to scene.
        cause: String,
        /// In full.
        message: String,
    },
    /// It was stopped because somebody wants it so.
    Cancelled,
    /// It goes back as it was: its worker ends, the set's budget is reached, another program is still in its folder.
    Again {
        /// Not before.
        wait_ms: i64,
    },
}

/// What became of a job whose turn ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JobResult {
    /// As asked.
    Kept,
    /// The job was another's by then, or ended: nothing was changed.
    NotOurs,
}

/// Which jobs are meant; what is left out does not matter.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Filter {
    /// The cause contains this.
    pub cause: Option<String>,
    /// The stage is this.
    pub stage: Option<String>,
    /// The scene is this.
    pub scene: Option<String>,
    /// Cancelled ones instead of failed ones.
    pub cancelled: bool,
}

impl Queue {
    /// Queues scenes; those that the set has already stay as they are. Returns how many are new.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn enqueue(&self, set: i64, jobs: &[NewJob]) -> Result<u64, BatchError> {
        let mut added = 0;
        for some in jobs.chunks(1000) {
            let json = serde_json::to_string(some).unwrap_or_default();
            // `WHERE true`: without it SQLite reads ON CONFLICT as a part of a join.
            let fresh = match self.kind {
                Kind::Sqlite => {
                    "SELECT value ->> 'scene' AS scene, value ->> 'photo' AS photo, value ->> 'hash' AS hash,
                        value ->> 'priority' AS priority, key AS n FROM json_each($2)"
                }
                Kind::Postgres => {
                    "SELECT value ->> 'scene' AS scene, value ->> 'photo' AS photo, value ->> 'hash' AS hash,
                        CAST(value ->> 'priority' AS BIGINT) AS priority, n
                     FROM json_array_elements(CAST($2 AS JSON)) WITH ORDINALITY AS e (value, n)"
                }
            };
            let query = self.sql(&format!(
                "INSERT INTO harmony_jobs (set_id, scene, photo, hash, priority, state, due, token, worker, cancel, attempts,
                    losses, ends, stage, cause, message, paid_usd, calls, started, ended, busy_ms)
                 SELECT CAST($1 AS BIGINT), scene, photo, hash, priority, 'queued', 0, 0, '', 0, 0, 0, 0, '', '', '', 0, 0,
                    0, 0, 0
                 FROM ({fresh}) AS fresh WHERE true ORDER BY n ON CONFLICT (set_id, scene) DO NOTHING"
            ));
            let done = sqlx::query(query).bind(set).bind(json).execute(&self.pool).await.map_err(|e| self.fail(&e))?;
            added += done.rows_affected();
        }
        Ok(added)
    }

    /// Claims the next scene of a set, if it is running and has one.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn claim(&self, set: &SetRow, worker: &str) -> Result<Option<Job>, BatchError> {
        let query = self.sql(
            "WITH next AS MATERIALIZED (
                SELECT id FROM harmony_jobs WHERE set_id = $1 AND state = 'queued'
                    AND EXISTS (SELECT 1 FROM harmony_sets WHERE harmony_sets.id = $1 AND harmony_sets.state = 'running')
                ORDER BY priority DESC, id LIMIT 1 {skip})
             UPDATE harmony_jobs SET state = 'running', worker = $2, token = token + 1, due = {now} + $3, started = {now}
             WHERE id = (SELECT id FROM next)
             RETURNING id, scene, photo, hash, token, attempts",
        );
        let row = sqlx::query(query)
            .bind(set.id)
            .bind(worker)
            .bind(set.lease_ms)
            .fetch_optional(&self.pool)
            .await
            .map_err(|e| self.fail(&e))?;
        let Some(row) = row else { return Ok(None) };
        Ok(Some(Job {
            id: self.read(&row, "id")?,
            scene: self.read(&row, "scene")?,
            photo: self.read(&row, "photo")?,
            hash: self.read(&row, "hash")?,
            token: self.read(&row, "token")?,
            attempts: self.read(&row, "attempts")?,
            set: set.clone(),
        }))
    }

    /// Renews the leases of all that a worker holds, and tells which that is.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn renew(&self, worker: &str) -> Result<Vec<Held>, BatchError> {
        let query = self.sql(
            "UPDATE harmony_jobs
             SET due = {now} + (SELECT lease_ms FROM harmony_sets WHERE harmony_sets.id = harmony_jobs.set_id)
             WHERE worker = $1 AND state = 'running' RETURNING id, token, cancel",
        );
        let rows = sqlx::query(query).bind(worker).fetch_all(&self.pool).await.map_err(|e| self.fail(&e))?;
        rows.iter()
            .map(|row| {
                let cancel: i64 = self.read(row, "cancel")?;
                Ok(Held { id: self.read(row, "id")?, token: self.read(row, "token")?, cancel: cancel != 0 })
            })
            .collect()
    }

    /// A job's turn has ended. Told twice, the second time changes nothing.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn finish(&self, job: &Job, ended: &Ended, bill_usd: Option<f64>) -> Result<JobResult, BatchError> {
        let cut = |text: &str| text.chars().take(MAX_MESSAGE).collect::<String>();
        let mut failed = (String::new(), String::new(), String::new());
        // An end by name, and when to go on where it is none.
        let (state, wait, failure) = match ended {
            Ended::Done => ("done", 0, false),
            Ended::Cancelled => ("cancelled", 0, false),
            Ended::Again { wait_ms: 0 } => ("queued", 0, false),
            Ended::Again { wait_ms } => ("waiting", *wait_ms, false),
            Ended::Failed { stage, cause, message } => {
                failed = (cut(stage), cut(cause), cut(message));
                if job.attempts + 1 >= job.set.attempts {
                    ("failed", 0, true)
                } else {
                    let doubled = job.set.retry_ms.saturating_mul(1 << job.attempts.clamp(0, 20));
                    ("waiting", doubled.min(MAX_RETRY_MS), true)
                }
            }
        };
        let mut transaction = self.begin().await?;
        self.lock_set(&mut transaction, job.set.id).await?;
        let query = self.sql(
            "UPDATE harmony_jobs SET
                state = CASE WHEN cancel = 1 AND $3 IN ('queued', 'waiting') THEN 'cancelled' ELSE $3 END,
                ends = ends + CASE WHEN $3 IN ('done', 'failed', 'cancelled') OR cancel = 1 THEN 1 ELSE 0 END,
                due = {now} + $4, worker = '', cancel = 0, attempts = attempts + $5,
                stage = CASE WHEN $5 = 1 THEN $6 ELSE stage END, cause = CASE WHEN $5 = 1 THEN $7 ELSE cause END,
                message = CASE WHEN $5 = 1 THEN $8 ELSE message END, bill_usd = CASE WHEN $9 >= 0 THEN $9 ELSE bill_usd END,
                ended = {now}, busy_ms = busy_ms + {now} - started
             WHERE id = $1 AND token = $2 AND state = 'running' RETURNING state",
        );
        let changed = sqlx::query(query)
            .bind(job.id)
            .bind(job.token)
            .bind(state)
            .bind(wait)
            .bind(i64::from(failure))
            .bind(failed.0)
            .bind(&failed.1)
            .bind(failed.2)
            .bind(bill_usd.unwrap_or(UNTOLD))
            .fetch_optional(&mut *transaction)
            .await
            .map_err(|e| self.fail(&e))?;
        if changed.is_none() {
            return Ok(JobResult::NotOurs);
        }
        self.land(&mut transaction, job.set.id, job.id, job.token).await?;
        if failure {
            let query = sqlx::query(
                "UPDATE harmony_sets SET failed_in_row = failed_in_row + 1,
                    reason = CASE WHEN state = 'running' AND streak > 0 AND failed_in_row + 1 >= streak THEN $2 ELSE reason END,
                    state = CASE WHEN state = 'running' AND streak > 0 AND failed_in_row + 1 >= streak THEN 'paused' ELSE state END
                 WHERE id = $1",
            );
            let reason = format!("failures: many in a row and no scene between them, the last one: {}", failed.1);
            query.bind(job.set.id).bind(reason).execute(&mut *transaction).await.map_err(|e| self.fail(&e))?;
        } else if *ended == Ended::Done {
            let query = sqlx::query("UPDATE harmony_sets SET failed_in_row = 0 WHERE id = $1 AND failed_in_row > 0");
            query.bind(job.set.id).execute(&mut *transaction).await.map_err(|e| self.fail(&e))?;
        }
        transaction.commit().await.map_err(|e| self.fail(&e))?;
        Ok(JobResult::Kept)
    }

    /// Puts retries that are due into the queue, and jobs back whose worker was silent for too long. Returns the scenes
    /// of the latter.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn tend(&self) -> Result<Vec<String>, BatchError> {
        sqlx::query(self.sql("UPDATE harmony_jobs SET state = 'queued' WHERE state = 'waiting' AND due <= {now}"))
            .execute(&self.pool)
            .await
            .map_err(|e| self.fail(&e))?;
        // After a restart of the database its workers have a lease's time to come back: their heartbeats could not be
        // heard.
        let lost = self.sql(
            "SELECT id, set_id FROM harmony_jobs WHERE state = 'running' AND due < {now}
                AND {up} > (SELECT lease_ms FROM harmony_sets WHERE harmony_sets.id = harmony_jobs.set_id) LIMIT 100",
        );
        let rows = sqlx::query(lost).fetch_all(&self.pool).await.map_err(|e| self.fail(&e))?;
        let mut scenes = Vec::new();
        for row in rows {
            scenes.extend(self.put_back(self.read(&row, "id")?, self.read(&row, "set_id")?).await?);
        }
        Ok(scenes)
    }

    /// Puts one job back whose lease is over; `None` when somebody else has just done so, or it was renewed.
    async fn put_back(&self, id: i64, set: i64) -> Result<Option<String>, BatchError> {
        let mut transaction = self.begin().await?;
        self.lock_set(&mut transaction, set).await?;
        let query = self.sql(
            "UPDATE harmony_jobs SET losses = losses + 1, worker = '', ended = {now}, busy_ms = busy_ms + {now} - started,
                cancel = 0,
                state = CASE WHEN cancel = 1 THEN 'cancelled'
                    WHEN losses + 1 >= (SELECT losses FROM harmony_sets WHERE harmony_sets.id = $2) THEN 'failed'
                    ELSE 'queued' END,
                ends = ends + CASE WHEN cancel = 1
                    OR losses + 1 >= (SELECT losses FROM harmony_sets WHERE harmony_sets.id = $2) THEN 1 ELSE 0 END,
                stage = 'crash', cause = 'its worker was lost', message = 'its worker was silent: ' || worker
             WHERE id = $1 AND state = 'running' AND due < {now} RETURNING scene, token",
        );
        let row = sqlx::query(query).bind(id).bind(set).fetch_optional(&mut *transaction).await;
        let Some(row) = row.map_err(|e| self.fail(&e))? else { return Ok(None) };
        self.land(&mut transaction, set, id, self.read(&row, "token")?).await?;
        transaction.commit().await.map_err(|e| self.fail(&e))?;
        Ok(Some(self.read(&row, "scene")?))
    }

    /// Calls that a job's turn left in flight: nobody knows whether they were paid, so they count as paid.
    async fn land(
        &self,
        transaction: &mut Transaction<'_, Any>,
        set: i64,
        job: i64,
        token: i64,
    ) -> Result<(), BatchError> {
        let query = sqlx::query("DELETE FROM harmony_flights WHERE job_id = $1 AND token <= $2 RETURNING usd");
        let rows = query.bind(job).bind(token).fetch_all(&mut **transaction).await.map_err(|e| self.fail(&e))?;
        if rows.is_empty() {
            return Ok(());
        }
        let mut usd = 0.0;
        for row in &rows {
            usd += self.read::<f64>(row, "usd")?;
        }
        self.book(transaction, set, job, usd, usd).await
    }

    /// Books what calls of a job cost in place of what they were expected to.
    pub(super) async fn book(
        &self,
        transaction: &mut Transaction<'_, Any>,
        set: i64,
        job: i64,
        expected: f64,
        usd: f64,
    ) -> Result<(), BatchError> {
        sqlx::query("UPDATE harmony_sets SET flying_usd = flying_usd - $2, spent_usd = spent_usd + $3 WHERE id = $1")
            .bind(set)
            .bind(expected)
            .bind(usd)
            .execute(&mut **transaction)
            .await
            .map_err(|e| self.fail(&e))?;
        sqlx::query("UPDATE harmony_jobs SET paid_usd = paid_usd + $2 WHERE id = $1")
            .bind(job)
            .bind(usd)
            .execute(&mut **transaction)
            .await
            .map_err(|e| self.fail(&e))?;
        Ok(())
    }

    pub(super) async fn lock_set(&self, transaction: &mut Transaction<'_, Any>, set: i64) -> Result<(), BatchError> {
        let query = self.sql("SELECT id FROM harmony_sets WHERE id = $1 {lock}");
        sqlx::query(query).bind(set).fetch_optional(&mut **transaction).await.map_err(|e| self.fail(&e))?;
        Ok(())
    }

    /// Puts failed (or cancelled) scenes back into the queue, their failures forgiven. Returns how many.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn retry(&self, set: i64, filter: &Filter) -> Result<u64, BatchError> {
        let state = if filter.cancelled { "cancelled" } else { "failed" };
        // A retry that waits is brought forward when it fits.
        let waiting = if filter.cancelled { "" } else { "OR state = 'waiting'" };
        let query = self.sql(&format!(
            "UPDATE harmony_jobs SET state = 'queued', attempts = 0, losses = 0, cancel = 0
             WHERE set_id = $1 AND (state = $2 {waiting})
                AND ($3 = '' OR stage = $3) AND ($4 = '' OR cause LIKE $4 ESCAPE '\\') AND ($5 = '' OR scene = $5)"
        ));
        let escaped = |t: &str| t.replace('\\', "\\\\").replace('%', "\\%").replace('_', "\\_");
        let done = sqlx::query(query)
            .bind(set)
            .bind(state)
            .bind(filter.stage.clone().unwrap_or_default())
            .bind(filter.cause.as_deref().map_or_else(String::new, |cause| format!("%{}%", escaped(cause))))
            .bind(filter.scene.clone().unwrap_or_default())
            .execute(&self.pool)
            .await
            .map_err(|e| self.fail(&e))?;
        Ok(done.rows_affected())
    }

    /// Sets the priority of scenes that have not begun. Returns how many.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn set_priority(&self, set: i64, scene: &str, priority: i64) -> Result<u64, BatchError> {
        let query = sqlx::query(
            "UPDATE harmony_jobs SET priority = $3 WHERE set_id = $1 AND ($2 = '' OR scene = $2) AND state IN ('queued', 'waiting')",
        );
        let done = query.bind(set).bind(scene).bind(priority).execute(&self.pool).await.map_err(|e| self.fail(&e))?;
        Ok(done.rows_affected())
    }

    /// Cancels one scene: at once when it waits, by its worker when it runs. Returns how many were meant.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn cancel_scene(&self, set: i64, scene: &str) -> Result<u64, BatchError> {
        let query = self.sql(
            "UPDATE harmony_jobs SET cancel = CASE WHEN state = 'running' THEN 1 ELSE 0 END,
                ends = ends + CASE WHEN state = 'running' THEN 0 ELSE 1 END,
                ended = CASE WHEN state = 'running' THEN ended ELSE {now} END,
                state = CASE WHEN state = 'running' THEN state ELSE 'cancelled' END
             WHERE set_id = $1 AND scene = $2 AND state IN ('queued', 'waiting', 'running')",
        );
        let done = sqlx::query(query).bind(set).bind(scene).execute(&self.pool).await.map_err(|e| self.fail(&e))?;
        Ok(done.rows_affected())
    }
}
