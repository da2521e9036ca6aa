//! Sets: what belongs together, and whether it goes on.

use serde::Serialize;
use sqlx::any::AnyRow;

use super::{Queue, UNTOLD};
use crate::BatchError;

/// Whether scenes of a set are begun.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SetState {
    /// Yes.
    Running,
    /// Not now; what runs goes on, workers wait.
    Paused,
    /// Not any more; what runs goes on, workers that wait for nothing else end.
    Draining,
    /// Not any more; what runs is stopped.
    Cancelled,
}

impl SetState {
    /// As it stands in the database and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Running => "running",
            Self::Paused => "paused",
            Self::Draining => "draining",
            Self::Cancelled => "cancelled",
        }
    }

    fn read(name: &str) -> Self {
        // Whatever a later version writes here: nothing is begun.
        [Self::Running, Self::Draining, Self::Cancelled].into_iter().find(|s| s.name() == name).unwrap_or(Self::Paused)
    }
}

/// A set to be made.
#[derive(Debug, Clone, PartialEq)]
pub struct NewSet {
    /// Its name in the queue; unique.
    pub name: String,
    /// Its folder, as whoever makes it sees it.
    pub folder: String,
    /// Arguments of the program, with `{photo}`, `{run}` and `{set}`.
    pub args: Vec<String>,
    /// Times that a scene may fail before it is set aside.
    pub attempts: i64,
    /// Times that a scene may take its worker with it, or lose it, before it is set aside.
    pub losses: i64,
    /// How long a worker may be silent.
    pub lease_ms: i64,
    /// Wait before the first retry; doubles.
    pub retry_ms: i64,
    /// How long a scene may take; 0 = for ever.
    pub timeout_ms: i64,
    /// Scenes in a row that fail before the set is paused; 0 = never.
    pub streak: i64,
}

/// A set.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[expect(missing_docs, reason = "as in NewSet")]
pub struct SetRow {
    pub id: i64,
    pub name: String,
    pub folder: String,
    pub args: Vec<String>,
    pub state: SetState,
    /// Why it is paused, when the program did so.
    pub reason: String,
    pub created: i64,
    pub attempts: i64,
    pub losses: i64,
    pub lease_ms: i64,
    pub retry_ms: i64,
    pub timeout_ms: i64,
    /// US dollars that all scenes may cost together.
    pub budget_usd: Option<f64>,
    /// Times that somebody outside may be asked for all scenes together.
    pub budget_calls: Option<i64>,
    /// US dollars spent, as far as known.
    pub spent_usd: f64,
    /// US dollars that calls in flight are expected to cost.
    pub flying_usd: f64,
    /// Times that somebody outside was asked.
    pub spent_calls: i64,
}

const COLUMNS: &str = "id, name, folder, args, state, reason, created, attempts, losses, lease_ms, retry_ms, timeout_ms, \
                       budget_usd, budget_calls, spent_usd, flying_usd, spent_calls";

impl Queue {
    fn set_row(&self, row: &AnyRow) -> Result<SetRow, BatchError> {
        let args: String = self.read(row, "args")?;
        let state: String = self.read(row, "state")?;
        Ok(SetRow {
            id: self.read(row, "id")?,
            name: self.read(row, "name")?,
            folder: self.read(row, "folder")?,
            args: serde_json::from_str(&args).map_err(|e| BatchError::Schema {
                queue: self.address().shown(),
                reason: format!("arguments of a set: {e}"),
            })?,
            state: SetState::read(&state),
            reason: self.read(row, "reason")?,
            created: self.read(row, "created")?,
            attempts: self.read(row, "attempts")?,
            losses: self.read(row, "losses")?,
            lease_ms: self.read(row, "lease_ms")?,
            retry_ms: self.read(row, "retry_ms")?,
            timeout_ms: self.read(row, "timeout_ms")?,
            budget_usd: self.read(row, "budget_usd")?,
            budget_calls: self.read(row, "budget_calls")?,
            spent_usd: self.read(row, "spent_usd")?,
            flying_usd: self.read(row, "flying_usd")?,
            spent_calls: self.read(row, "spent_calls")?,
        })
    }

    /// Makes a set, or finds the one of that name as it is.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn put_set(&self, new: &NewSet) -> Result<SetRow, BatchError> {
        let args = serde_json::to_string(&new.args).unwrap_or_default();
        sqlx::query(self.sql(
            "INSERT INTO harmony_sets (name, folder, args, state, reason, created, attempts, losses, lease_ms, retry_ms,
                timeout_ms, streak, failed_in_row, spent_usd, flying_usd, spent_calls)
             VALUES ($1, $2, $3, 'running', '', {now}, $4, $5, $6, $7, $8, $9, 0, 0, 0, 0) ON CONFLICT (name) DO NOTHING",
        ))
        .bind(&new.name)
        .bind(&new.folder)
        .bind(args)
        .bind(new.attempts)
        .bind(new.losses)
        .bind(new.lease_ms)
        .bind(new.retry_ms)
        .bind(new.timeout_ms)
        .bind(new.streak)
        .execute(&self.pool)
        .await
        .map_err(|e| self.fail(&e))?;
        self.set(&new.name).await
    }

    /// The set of a name.
    ///
    /// # Errors
    /// [`BatchError::Unknown`], [`BatchError::Database`].
    pub async fn set(&self, name: &str) -> Result<SetRow, BatchError> {
        let query = self.sql(&format!("SELECT {COLUMNS} FROM harmony_sets WHERE name = $1"));
        let row = sqlx::query(query).bind(name).fetch_optional(&self.pool).await.map_err(|e| self.fail(&e))?;
        let row = row
            .ok_or_else(|| BatchError::Unknown(format!("the queue {} knows no set {name}", self.address().shown())))?;
        self.set_row(&row)
    }

    /// All sets, oldest first.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn sets(&self) -> Result<Vec<SetRow>, BatchError> {
        let query = self.sql(&format!("SELECT {COLUMNS} FROM harmony_sets ORDER BY id"));
        let rows = sqlx::query(query).fetch_all(&self.pool).await.map_err(|e| self.fail(&e))?;
        rows.iter().map(|row| self.set_row(row)).collect()
    }

    /// Pauses, drains or resumes a set. Cancelling is [`Queue::cancel_set`].
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn set_state(&self, set: i64, state: SetState, reason: &str) -> Result<(), BatchError> {
        // Whoever resumes has seen what failed.
        sqlx::query("UPDATE harmony_sets SET state = $2, reason = $3, failed_in_row = 0 WHERE id = $1")
            .bind(set)
            .bind(state.name())
            .bind(reason)
            .execute(&self.pool)
            .await
            .map_err(|e| self.fail(&e))?;
        Ok(())
    }

    /// Cancels a set: what waits is cancelled at once, what runs is stopped by its worker. Returns how many of each.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn cancel_set(&self, set: i64) -> Result<(u64, u64), BatchError> {
        let mut transaction = self.begin().await?;
        sqlx::query("UPDATE harmony_sets SET state = 'cancelled', reason = '' WHERE id = $1")
            .bind(set)
            .execute(&mut *transaction)
            .await
            .map_err(|e| self.fail(&e))?;
        let waiting = sqlx::query(self.sql(
            "UPDATE harmony_jobs SET state = 'cancelled', ended = {now}, ends = ends + 1
             WHERE set_id = $1 AND state IN ('queued', 'waiting')",
        ));
        let waiting = waiting.bind(set).execute(&mut *transaction).await.map_err(|e| self.fail(&e))?.rows_affected();
        let running = sqlx::query("UPDATE harmony_jobs SET cancel = 1 WHERE set_id = $1 AND state = 'running'");
        let running = running.bind(set).execute(&mut *transaction).await.map_err(|e| self.fail(&e))?.rows_affected();
        transaction.commit().await.map_err(|e| self.fail(&e))?;
        Ok((waiting, running))
    }

    /// Sets what all scenes of a set may cost together; `None` leaves a limit as it is. A set that was paused because
    /// a budget was reached goes on.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn set_budget(&self, set: i64, usd: Option<f64>, calls: Option<i64>) -> Result<(), BatchError> {
        sqlx::query(
            "UPDATE harmony_sets SET budget_usd = CASE WHEN $2 >= 0 THEN $2 ELSE budget_usd END,
                budget_calls = CASE WHEN $3 >= 0 THEN $3 ELSE budget_calls END,
                state = CASE WHEN state = 'paused' AND reason LIKE 'budget:%' THEN 'running' ELSE state END
             WHERE id = $1",
        )
        .bind(set)
        .bind(usd.unwrap_or(UNTOLD))
        .bind(calls.unwrap_or(-1))
        .execute(&self.pool)
        .await
        .map_err(|e| self.fail(&e))?;
        Ok(())
    }
}
