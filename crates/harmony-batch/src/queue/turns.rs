//! Turns at players: rates, places and money, counted for all programs that work from one queue.
//!
//! A try that is made is a row of `harmony_flights` until it is over; places are the rows of a player, expected money
//! is their sum. What a program leaves in flight when it dies lands with its job (`Queue::finish`, `Queue::tend`).
//! A program whose job was taken over, or cancelled, gets no turn: two programs never ask for one scene.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use async_trait::async_trait;
use harmony_calls::{SharedAsk, SharedLimits, SharedOver, SharedTurn};
use tokio::task::JoinSet;

use super::Queue;
use crate::BatchError;
use crate::window::{Counted, Window};

/// A minute, milliseconds.
const MINUTE_MS: i64 = 60_000;

/// How long to wait for a place: nobody tells when one gets free.
const PLACE_WAIT: Duration = Duration::from_millis(150);

/// How long to wait when the database does not answer.
const OUTAGE_WAIT: Duration = Duration::from_secs(1);

/// The players as one job of a queue sees them.
#[derive(Debug, Clone)]
pub struct SharedPlayers {
    queue: Queue,
    set: i64,
    job: i64,
    token: i64,
    /// Roles whose players are this machine's own, and its name: their limits hold on this machine only.
    own: Vec<harmony_roles::Role>,
    host: String,
    minute_ms: i64,
    /// Ends of calls that are being told.
    telling: Arc<Mutex<JoinSet<()>>>,
}

impl SharedPlayers {
    /// For a job that was claimed.
    pub fn new(queue: Queue, (set, job, token): (i64, i64, i64), host: String) -> Self {
        // The path tracer is a process on this machine, whatever the profile.
        Self {
            queue,
            set,
            job,
            token,
            own: vec![harmony_roles::Role::LitRenderer],
            host,
            minute_ms: MINUTE_MS,
            telling: Arc::default(),
        }
    }

    /// Roles whose players are on each worker's machine: places and rates hold there, not over all machines.
    #[must_use]
    pub fn with_own(mut self, roles: impl IntoIterator<Item = harmony_roles::Role>) -> Self {
        self.own.extend(roles);
        self
    }

    /// Length of the minute that rates are counted in; for tests whose times are scaled down.
    #[must_use]
    pub fn with_minute(mut self, minute: Duration) -> Self {
        self.minute_ms = i64::try_from(minute.as_millis()).unwrap_or(MINUTE_MS).max(1);
        self
    }

    /// Waits until the ends of calls are told, at most so long.
    pub async fn flush(&self, patience: Duration) {
        let mut telling = std::mem::take(&mut *self.telling.lock().unwrap_or_else(PoisonError::into_inner));
        let _ = tokio::time::timeout(patience, async { while telling.join_next().await.is_some() {} }).await;
    }

    async fn tell_over(&self, number: i64, over: SharedOver) {
        // Tried for a while, for a restart of the database takes seconds. What stays untold lands with its job as expected.
        for attempt in 0..20 {
            match self.over(number, over).await {
                Ok(()) => return,
                Err(error) => {
                    tracing::warn!("{error}; a call's end is told again in a moment");
                    tokio::time::sleep(Duration::from_millis(100 + 100 * attempt)).await;
                }
            }
        }
    }

    fn key(&self, player: &str, model: &str, own: bool) -> String {
        let place = if own { format!(" @ {}", self.host) } else { String::new() };
        format!("{player} / {model}{place}")
    }

    async fn ask(&self, ask: &SharedAsk) -> Result<SharedTurn, BatchError> {
        let queue = &self.queue;
        let key = self.key(&ask.player, &ask.model, self.own.contains(&ask.role));
        let expected = ask.expected_usd.unwrap_or(0.0);
        let mut transaction = queue.begin().await?;
        let fail = |e: sqlx::Error| queue.fail(&e);
        let mut window = queue.window(&mut transaction, &key).await?;
        let now = window.1;
        // Still ours?
        let job = sqlx::query(
            "SELECT id FROM harmony_jobs WHERE id = $1 AND token = $2 AND state = 'running' AND cancel = 0",
        );
        let job = job.bind(self.job).bind(self.token).fetch_optional(&mut *transaction).await.map_err(fail)?;
        if job.is_none() {
            return Ok(SharedTurn::Stop("the queue gave this scene to another worker, or it was cancelled".to_owned()));
        }
        if ask.places > 0 {
            let row = sqlx::query("SELECT count(*) AS n FROM harmony_flights WHERE player = $1").bind(&key);
            let row = row.fetch_one(&mut *transaction).await.map_err(fail)?;
            if queue.read::<i64>(&row, "n")? >= i64::try_from(ask.places).unwrap_or(i64::MAX) {
                return Ok(SharedTurn::Wait(PLACE_WAIT.mul_f64(0.5 + rand::random::<f64>())));
            }
        }
        let counted = match window.0.admit(now, &ask.limits, self.minute_ms) {
            Ok(counted) => counted,
            // Some spread, so that all who wait do not come in one moment.
            Err(wait) => {
                let spread = 1.0 + 0.05 * rand::random::<f64>();
                return Ok(SharedTurn::Wait(Duration::from_millis(wait.unsigned_abs()).mul_f64(spread)));
            }
        };
        let paid = sqlx::query(
            "UPDATE harmony_sets SET flying_usd = flying_usd + $2, spent_calls = spent_calls + 1 WHERE id = $1
                AND (budget_usd IS NULL OR spent_usd + flying_usd + $2 <= budget_usd + 0.000000001)
                AND (budget_calls IS NULL OR spent_calls < budget_calls) RETURNING id",
        );
        let paid = paid.bind(self.set).bind(expected).fetch_optional(&mut *transaction).await.map_err(fail)?;
        if paid.is_none() {
            let reason = "budget: the next call would go beyond what this set may cost";
            let pause = sqlx::query(
                "UPDATE harmony_sets SET state = 'paused', reason = $2 WHERE id = $1 AND state IN ('running', 'draining')",
            );
            pause.bind(self.set).bind(reason).execute(&mut *transaction).await.map_err(fail)?;
            transaction.commit().await.map_err(fail)?;
            return Ok(SharedTurn::Budget(format!("{reason}; `harmony batch resume SET --max-usd USD` raises it")));
        }
        queue.keep_window(&mut transaction, &key, &window.0).await?;
        let flight = sqlx::query(
            "INSERT INTO harmony_flights (player, set_id, job_id, token, usd, slot, tokens, begun)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8) RETURNING id",
        );
        let row = flight
            .bind(&key)
            .bind(self.set)
            .bind(self.job)
            .bind(self.token)
            .bind(expected)
            .bind(counted.slot)
            .bind(i64::try_from(counted.expected).unwrap_or(i64::MAX))
            .bind(now)
            .fetch_one(&mut *transaction)
            .await
            .map_err(fail)?;
        let number: i64 = queue.read(&row, "id")?;
        sqlx::query("UPDATE harmony_jobs SET calls = calls + 1 WHERE id = $1")
            .bind(self.job)
            .execute(&mut *transaction)
            .await
            .map_err(fail)?;
        transaction.commit().await.map_err(fail)?;
        Ok(SharedTurn::Go(number))
    }

    async fn over(&self, number: i64, over: SharedOver) -> Result<(), BatchError> {
        let queue = &self.queue;
        let fail = |e: sqlx::Error| queue.fail(&e);
        // Read before locking, so that rows are locked in one order everywhere.
        let row = sqlx::query("SELECT player FROM harmony_flights WHERE id = $1").bind(number);
        let Some(row) = row.fetch_optional(&queue.pool).await.map_err(fail)? else { return Ok(()) };
        let key: String = queue.read(&row, "player")?;
        let mut transaction = queue.begin().await?;
        let (mut window, now) = queue.window(&mut transaction, &key).await?;
        queue.lock_set(&mut transaction, self.set).await?;
        let row = sqlx::query("DELETE FROM harmony_flights WHERE id = $1 RETURNING usd, slot, tokens").bind(number);
        // It may have landed with its job meanwhile.
        let Some(row) = row.fetch_optional(&mut *transaction).await.map_err(fail)? else { return Ok(()) };
        let expected: f64 = queue.read(&row, "usd")?;
        let counted =
            Counted { slot: queue.read(&row, "slot")?, expected: queue.read::<i64>(&row, "tokens")?.unsigned_abs() };
        window.used(counted, over.tokens.unwrap_or(0));
        if let Some(closed) = over.closed_for {
            window.close_until(now + i64::try_from(closed.as_millis()).unwrap_or(i64::MAX / 4));
        }
        queue.keep_window(&mut transaction, &key, &window).await?;
        queue.book(&mut transaction, self.set, self.job, expected, over.cost_usd.unwrap_or(expected)).await?;
        transaction.commit().await.map_err(fail)
    }

    async fn told(&self, player: &str, model: &str, wait: Duration) -> Result<(), BatchError> {
        // Nobody says for which role: whoever has one key for all machines is told under it, and so is our own.
        for own in [false, true] {
            let key = self.key(player, model, own);
            let mut transaction = self.queue.begin().await?;
            let known = sqlx::query("SELECT name FROM harmony_players WHERE name = $1").bind(&key);
            if known.fetch_optional(&mut *transaction).await.map_err(|e| self.queue.fail(&e))?.is_some() {
                let (mut window, now) = self.queue.window(&mut transaction, &key).await?;
                window.refused(now, i64::try_from(wait.as_millis()).unwrap_or(i64::MAX / 4), self.minute_ms);
                self.queue.keep_window(&mut transaction, &key, &window).await?;
            }
            transaction.commit().await.map_err(|e| self.queue.fail(&e))?;
        }
        Ok(())
    }
}

impl Queue {
    /// A player's state, its row locked until the transaction ends; and the database's time.
    async fn window(
        &self,
        transaction: &mut sqlx::Transaction<'_, sqlx::Any>,
        key: &str,
    ) -> Result<(Window, i64), BatchError> {
        for _ in 0..2 {
            let query = self.sql("SELECT state, {now} AS now FROM harmony_players WHERE name = $1 {lock}");
            let row = sqlx::query(query).bind(key).fetch_optional(&mut **transaction).await;
            if let Some(row) = row.map_err(|e| self.fail(&e))? {
                let state: String = self.read(&row, "state")?;
                // A state that cannot be read is one of another version: counting begins anew.
                return Ok((serde_json::from_str(&state).unwrap_or_default(), self.read(&row, "now")?));
            }
            sqlx::query("INSERT INTO harmony_players (name, state) VALUES ($1, '{}') ON CONFLICT (name) DO NOTHING")
                .bind(key)
                .execute(&mut **transaction)
                .await
                .map_err(|e| self.fail(&e))?;
        }
        let reason = format!("the row of player {key} goes as it comes");
        Err(BatchError::Database { queue: self.address().shown(), reason, passing: true })
    }

    async fn keep_window(
        &self,
        transaction: &mut sqlx::Transaction<'_, sqlx::Any>,
        key: &str,
        window: &Window,
    ) -> Result<(), BatchError> {
        let state = serde_json::to_string(window).unwrap_or_default();
        let query = sqlx::query("UPDATE harmony_players SET state = $2 WHERE name = $1").bind(key).bind(state);
        query.execute(&mut **transaction).await.map_err(|e| self.fail(&e))?;
        Ok(())
    }
}

#[async_trait]
impl SharedLimits for SharedPlayers {
    async fn take(&self, ask: &SharedAsk) -> SharedTurn {
        match self.ask(ask).await {
            Ok(turn) => turn,
            // Nobody is asked while nobody counts.
            Err(error) => {
                tracing::warn!("{error}; waiting");
                SharedTurn::Wait(OUTAGE_WAIT)
            }
        }
    }

    async fn settle(&self, number: i64, over: SharedOver) {
        // Beside the run: the record of a paid answer must not wait for a database.
        let this = self.clone();
        let mut telling = self.telling.lock().unwrap_or_else(PoisonError::into_inner);
        while telling.try_join_next().is_some() {}
        telling.spawn(async move { this.tell_over(number, over).await });
    }

    async fn refused(&self, player: &str, model: &str, wait: Duration) {
        if let Err(error) = self.told(player, model, wait).await {
            tracing::warn!("{error}; a refusal of {player} is not shared");
        }
    }
}
