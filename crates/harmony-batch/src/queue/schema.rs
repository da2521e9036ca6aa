//! The tables, and what to do with a database that has others.

use sqlx::Row as _;

use super::{Kind, Queue, SCHEMA_VERSION};
use crate::BatchError;

/// All tables and indices; `{key}` is a key that counts itself.
const TABLES: &[&str] = &[
    "CREATE TABLE harmony_queue (version BIGINT NOT NULL)",
    "CREATE TABLE harmony_sets (
        id {key}, name TEXT NOT NULL UNIQUE, folder TEXT NOT NULL, args TEXT NOT NULL,
        state TEXT NOT NULL, reason TEXT NOT NULL, created BIGINT NOT NULL,
        attempts BIGINT NOT NULL, losses BIGINT NOT NULL, lease_ms BIGINT NOT NULL, retry_ms BIGINT NOT NULL,
        timeout_ms BIGINT NOT NULL, streak BIGINT NOT NULL, failed_in_row BIGINT NOT NULL,
        budget_usd DOUBLE PRECISION, budget_calls BIGINT,
        spent_usd DOUBLE PRECISION NOT NULL, flying_usd DOUBLE PRECISION NOT NULL, spent_calls BIGINT NOT NULL)",
    "CREATE TABLE harmony_jobs (
        id {key}, set_id BIGINT NOT NULL REFERENCES harmony_sets (id), scene TEXT NOT NULL, photo TEXT NOT NULL,
        hash TEXT NOT NULL, priority BIGINT NOT NULL, state TEXT NOT NULL, due BIGINT NOT NULL, token BIGINT NOT NULL,
        worker TEXT NOT NULL, cancel BIGINT NOT NULL, attempts BIGINT NOT NULL, losses BIGINT NOT NULL,
        ends BIGINT NOT NULL, stage TEXT NOT NULL, cause TEXT NOT NULL, message TEXT NOT NULL,
        paid_usd DOUBLE PRECISION NOT NULL, calls BIGINT NOT NULL, bill_usd DOUBLE PRECISION,
        started BIGINT NOT NULL, ended BIGINT NOT NULL, busy_ms BIGINT NOT NULL, UNIQUE (set_id, scene))",
    // The next job is this index's first row, however many there are.
    "CREATE INDEX harmony_jobs_next ON harmony_jobs (set_id, priority DESC, id) WHERE state = 'queued'",
    // Leases that end and retries that are due.
    "CREATE INDEX harmony_jobs_due ON harmony_jobs (state, due) WHERE state IN ('running', 'waiting')",
    "CREATE INDEX harmony_jobs_worker ON harmony_jobs (worker) WHERE state = 'running'",
    "CREATE INDEX harmony_jobs_ended ON harmony_jobs (set_id, state, ended)",
    "CREATE TABLE harmony_workers (
        name TEXT PRIMARY KEY, host TEXT NOT NULL, pid BIGINT NOT NULL, slots BIGINT NOT NULL, busy BIGINT NOT NULL,
        seen BIGINT NOT NULL)",
    "CREATE TABLE harmony_players (name TEXT PRIMARY KEY, state TEXT NOT NULL)",
    "CREATE TABLE harmony_flights (
        id {key}, player TEXT NOT NULL, set_id BIGINT NOT NULL, job_id BIGINT NOT NULL, token BIGINT NOT NULL,
        usd DOUBLE PRECISION NOT NULL, slot BIGINT NOT NULL, tokens BIGINT NOT NULL, begun BIGINT NOT NULL)",
    "CREATE INDEX harmony_flights_player ON harmony_flights (player)",
    "CREATE INDEX harmony_flights_job ON harmony_flights (job_id)",
];

/// What a database has.
enum Found {
    Nothing,
    Queue(i64),
    Other(String),
}

impl Queue {
    /// Makes the tables where there are none and they may be made; refuses a database that holds something else.
    pub(super) async fn prepare(&self, make: bool) -> Result<(), BatchError> {
        let other = |reason: String| BatchError::Schema { queue: self.address().shown(), reason };
        match self.look().await? {
            Found::Queue(SCHEMA_VERSION) => Ok(()),
            Found::Queue(version) => {
                Err(other(format!("its tables are of version {version}, this program's of version {SCHEMA_VERSION}")))
            }
            Found::Other(what) => Err(other(what)),
            Found::Nothing if !make => {
                Err(other("it has no tables of a queue (`harmony batch` makes them)".to_owned()))
            }
            Found::Nothing => self.make().await,
        }
    }

    async fn look(&self) -> Result<Found, BatchError> {
        let names = match self.kind {
            Kind::Sqlite => {
                "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite_%' ORDER BY name"
            }
            Kind::Postgres => {
                "SELECT CAST(tablename AS TEXT) AS name FROM pg_tables WHERE schemaname = current_schema() ORDER BY tablename"
            }
        };
        let rows = sqlx::query(names).fetch_all(&self.pool).await.map_err(|e| self.fail(&e))?;
        let names: Vec<String> = rows.iter().map(|row| self.read(row, "name")).collect::<Result<_, _>>()?;
        let ours: Vec<&String> = names.iter().filter(|name| name.starts_with("harmony_")).collect();
        if names.iter().any(|name| name == "harmony_queue") {
            let row = sqlx::query("SELECT version FROM harmony_queue").fetch_optional(&self.pool).await;
            let Ok(Some(row)) = row else { return Ok(Found::Other("its table harmony_queue is not ours".to_owned())) };
            // One of another type is of another program.
            return Ok(row
                .try_get("version")
                .map_or_else(|_| Found::Other("its table harmony_queue is not ours".to_owned()), Found::Queue));
        }
        if let Some(name) = ours.first() {
            return Ok(Found::Other(format!("it has a table {name} without harmony_queue")));
        }
        // An SQLite file is wholly ours or not at all; a PostgreSQL database may hold other tables.
        match names.first() {
            Some(name) if self.kind == Kind::Sqlite => {
                Ok(Found::Other(format!("the file belongs to another program: it has a table {name}")))
            }
            _ => Ok(Found::Nothing),
        }
    }

    /// All tables or none. Two programs that begin at once: the second finds them made.
    async fn make(&self) -> Result<(), BatchError> {
        let mut transaction = self.begin().await?;
        if self.kind == Kind::Postgres {
            // A number of our own, so that two do not make the tables at once.
            let lock = sqlx::query("SELECT pg_advisory_xact_lock(7310231)");
            lock.execute(&mut *transaction).await.map_err(|e| self.fail(&e))?;
        }
        let made = match self.kind {
            Kind::Sqlite => "SELECT count(*) AS n FROM sqlite_master WHERE name = 'harmony_queue'",
            Kind::Postgres => {
                "SELECT count(*) AS n FROM pg_tables WHERE schemaname = current_schema() AND tablename = 'harmony_queue'"
            }
        };
        let row = sqlx::query(made).fetch_one(&mut *transaction).await.map_err(|e| self.fail(&e))?;
        if self.read::<i64>(&row, "n")? == 0 {
            for table in TABLES {
                sqlx::query(self.sql(table)).execute(&mut *transaction).await.map_err(|e| self.fail(&e))?;
            }
            let version = sqlx::query("INSERT INTO harmony_queue (version) VALUES ($1)").bind(SCHEMA_VERSION);
            version.execute(&mut *transaction).await.map_err(|e| self.fail(&e))?;
        }
        transaction.commit().await.map_err(|e| self.fail(&e))
    }
}
