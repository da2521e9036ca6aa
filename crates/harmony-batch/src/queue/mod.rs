//! The queue: a few tables in SQLite (one machine) or PostgreSQL (many), with the same statements on both.
//!
//! Idea: the queue says who works on which scene *now*, and counts what all of them take together. It is no record of
//! what a scene is: that is the run folder (`docs/decisions/0002-records-are-the-state.md`), so that a queue that is
//! lost can be made again from the set's folder, and a scene that is begun twice asks nothing twice.
//!
//! * A job is claimed for a time (its lease) under a token that grows with each claim; whoever comes back with an old
//!   token changes nothing. Leases are renewed by the worker's heartbeat, and end by the *database's* clock.
//! * Claims take the first row of a partial index, whatever the number of rows (`FOR UPDATE SKIP LOCKED` on PostgreSQL;
//!   SQLite has one writer at a time).
//! * Times are milliseconds since 1970 of the database's clock.
//!
//! Limits: two digits of workers on one SQLite file, which must be on a local disk; hundreds of claims a second on
//! PostgreSQL. Why not a queue library: `docs/decisions/0033-batch-queue.md`.

mod jobs;
mod report;
mod schema;
mod sets;
mod turns;

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use sqlx::any::{AnyPoolOptions, AnyRow};
use sqlx::{AnyConnection, AnyPool, AssertSqlSafe, Connection as _, Executor as _, Row as _};

use crate::BatchError;

pub use jobs::{Ended, Filter, Held, Job, JobResult, NewJob};
pub use report::{CauseCount, Counts, SceneRow, StageCount, WorkerRow};
pub use sets::{NewSet, SetRow, SetState};
pub use turns::SharedPlayers;

/// Version of the tables.
pub const SCHEMA_VERSION: i64 = 1;

/// An amount that nobody told. Never NULL: PostgreSQL plans a statement once a connection, by the type of the first value that it
/// gets, and a NULL has none; the first amount after it was refused ("incorrect binary data format").
const UNTOLD: f64 = -1.0;

/// Longest wait for a connection, and for SQLite's one writer.
const PATIENCE: Duration = Duration::from_secs(30);

/// Which database.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Sqlite,
    Postgres,
}

/// Where a queue is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum QueueAddress {
    /// An SQLite file on this machine.
    File(PathBuf),
    /// `postgres://...`, perhaps with a password.
    Postgres(String),
}

impl QueueAddress {
    /// Reads an address: `postgres://...`, or a path.
    ///
    /// # Errors
    /// [`BatchError::Address`].
    pub fn parse(text: &str) -> Result<Self, BatchError> {
        let refused = |reason: &str| BatchError::Address { address: without_password(text), reason: reason.to_owned() };
        if text.starts_with("postgres://") || text.starts_with("postgresql://") {
            return Ok(Self::Postgres(text.to_owned()));
        }
        if let Some((scheme, _)) = text.split_once("://") {
            return Err(refused(&format!("{scheme} is neither a file nor postgres")));
        }
        if text.is_empty() {
            return Err(refused("it is empty"));
        }
        Ok(Self::File(PathBuf::from(text)))
    }

    /// For people and files: without a password.
    pub fn shown(&self) -> String {
        match self {
            Self::File(path) => path.display().to_string(),
            Self::Postgres(url) => without_password(url),
        }
    }

    /// In full, for the programs that a worker starts.
    pub fn full(&self) -> String {
        match self {
            Self::File(path) => path.display().to_string(),
            Self::Postgres(url) => url.clone(),
        }
    }
}

/// An address without its password.
fn without_password(url: &str) -> String {
    let Some((scheme, rest)) = url.split_once("://") else { return url.to_owned() };
    let end = rest.find('/').unwrap_or(rest.len());
    let Some(at) = rest[..end].rfind('@') else { return url.to_owned() };
    let user = rest[..at].split(':').next().unwrap_or_default();
    format!("{scheme}://{user}{}", &rest[at..])
}

/// An open queue.
#[derive(Debug, Clone)]
pub struct Queue {
    pool: AnyPool,
    kind: Kind,
    address: QueueAddress,
}

impl Queue {
    /// Opens a queue; its tables are made when the database has none of them.
    ///
    /// # Errors
    /// [`BatchError::Database`], or [`BatchError::Schema`] when the database holds something else.
    pub async fn create(address: &QueueAddress, connections: u32) -> Result<Self, BatchError> {
        let queue = Self::connect(address, connections, true).await?;
        queue.prepare(true).await?;
        Ok(queue)
    }

    /// Opens a queue that is there.
    ///
    /// # Errors
    /// As [`Queue::create`].
    pub async fn open(address: &QueueAddress, connections: u32) -> Result<Self, BatchError> {
        let queue = Self::connect(address, connections, false).await?;
        queue.prepare(false).await?;
        Ok(queue)
    }

    async fn connect(address: &QueueAddress, connections: u32, make: bool) -> Result<Self, BatchError> {
        sqlx::any::install_default_drivers();
        let (kind, url) = match address {
            QueueAddress::Postgres(url) => (Kind::Postgres, url.clone()),
            QueueAddress::File(path) => {
                let url = file_url(path, make)?;
                if !may_be_database(path) {
                    let reason = "the file is no SQLite database".to_owned();
                    return Err(BatchError::Schema { queue: address.shown(), reason });
                }
                (Kind::Sqlite, url)
            }
        };
        if kind == Kind::Postgres {
            // A pool tries for as long as it has patience; a server that is not there is told at once.
            let first = AnyConnection::connect(&url).await.map_err(|e| failed(address, &e))?;
            first.close().await.map_err(|e| failed(address, &e))?;
        }
        let options = AnyPoolOptions::new()
            .max_connections(connections.max(1))
            .acquire_timeout(PATIENCE)
            .after_connect(move |connection, _| Box::pin(async move { settle_in(connection, kind).await }));
        let pool = options.connect(&url).await.map_err(|e| failed(address, &e))?;
        Ok(Self { pool, kind, address: address.clone() })
    }

    /// Where it is.
    pub fn address(&self) -> &QueueAddress {
        &self.address
    }

    /// Closes all connections.
    pub async fn close(&self) {
        self.pool.close().await;
    }

    pub(crate) fn fail(&self, error: &sqlx::Error) -> BatchError {
        failed(&self.address, error)
    }

    /// A statement in this database's dialect: `{now}` its clock in milliseconds, `{lock}` and `{skip}` locks of the
    /// rows that are read, `{key}` the type of a key that counts itself, `{up}` how long the server has been up.
    fn sql(&self, text: &str) -> AssertSqlSafe<String> {
        let (now, lock, skip, key, up) = match self.kind {
            Kind::Sqlite => (
                "CAST(unixepoch('subsec') * 1000 AS INTEGER)",
                "",
                "",
                "INTEGER PRIMARY KEY AUTOINCREMENT",
                // Files have no server.
                "9223372036854775807",
            ),
            Kind::Postgres => (
                "CAST(extract(epoch FROM clock_timestamp()) * 1000 AS BIGINT)",
                "FOR UPDATE",
                "FOR UPDATE SKIP LOCKED",
                "BIGINT GENERATED ALWAYS AS IDENTITY PRIMARY KEY",
                "CAST(extract(epoch FROM clock_timestamp() - pg_postmaster_start_time()) * 1000 AS BIGINT)",
            ),
        };
        let text = text
            .replace("{up}", up)
            .replace("{now}", now)
            .replace("{lock}", lock)
            .replace("{skip}", skip)
            .replace("{key}", key);
        AssertSqlSafe(text)
    }

    /// Begins a transaction that will write: SQLite gives it the one writer's place at once.
    async fn begin(&self) -> Result<sqlx::Transaction<'static, sqlx::Any>, BatchError> {
        let statement = match self.kind {
            Kind::Sqlite => "BEGIN IMMEDIATE",
            Kind::Postgres => "BEGIN",
        };
        self.pool.begin_with(statement).await.map_err(|e| self.fail(&e))
    }

    /// The database's clock.
    ///
    /// # Errors
    /// [`BatchError::Database`].
    pub async fn now(&self) -> Result<i64, BatchError> {
        let row =
            sqlx::query(self.sql("SELECT {now} AS now")).fetch_one(&self.pool).await.map_err(|e| self.fail(&e))?;
        self.read(&row, "now")
    }

    /// A column.
    fn read<'r, T>(&self, row: &'r AnyRow, column: &str) -> Result<T, BatchError>
    where
        T: sqlx::Decode<'r, sqlx::Any> + sqlx::Type<sqlx::Any>,
    {
        row.try_get(column).map_err(|e| self.fail(&e))
    }
}

/// What each connection begins with.
async fn settle_in(connection: &mut AnyConnection, kind: Kind) -> Result<(), sqlx::Error> {
    if kind == Kind::Sqlite {
        // Readers beside the one writer. A power cut may lose the last moments, never the file: a scene is then begun
        // again, and its records answer.
        connection.execute("PRAGMA busy_timeout = 30000").await?;
        connection.execute("PRAGMA journal_mode = WAL").await?;
        connection.execute("PRAGMA synchronous = NORMAL").await?;
    }
    Ok(())
}

/// The address of an SQLite file for the driver.
fn file_url(path: &Path, make: bool) -> Result<String, BatchError> {
    let refused = |reason: String| BatchError::Address { address: path.display().to_string(), reason };
    let absolute = std::path::absolute(path).map_err(|e| refused(e.to_string()))?;
    let text = absolute.to_str().ok_or_else(|| refused("the path is not Unicode".to_owned()))?;
    if !make && !absolute.is_file() {
        return Err(refused("there is no such file".to_owned()));
    }
    let escaped = text.replace('%', "%25").replace('?', "%3F").replace('#', "%23");
    Ok(format!("sqlite://{escaped}?mode={}", if make { "rwc" } else { "rw" }))
}

/// Whether a file is absent, empty, or begins as SQLite's do. Looked at here: the driver would try for half a minute.
fn may_be_database(path: &Path) -> bool {
    let mut head = Vec::new();
    match File::open(path).and_then(|file| file.take(16).read_to_end(&mut head)) {
        Ok(_) => head.is_empty() || head == *b"SQLite format 3\0",
        Err(_) => true,
    }
}

/// Sorts what a database says.
fn failed(address: &QueueAddress, error: &sqlx::Error) -> BatchError {
    let passing = match error {
        sqlx::Error::Io(_) | sqlx::Error::PoolTimedOut | sqlx::Error::WorkerCrashed | sqlx::Error::Protocol(_) => true,
        sqlx::Error::Database(e) => {
            let code = e.code().unwrap_or_default();
            // PostgreSQL: connections, serialisation, deadlocks, shutting down and starting up, too many clients.
            // SQLite: busy and locked, with their extensions.
            let postgres = ["08", "40", "53", "57P"].iter().any(|class| code.starts_with(class)) && code.len() == 5;
            let sqlite = code.parse::<i64>().is_ok_and(|n| matches!(n & 0xff, 5 | 6)) && code.len() < 5;
            postgres || sqlite
        }
        _ => false,
    };
    BatchError::Database { queue: address.shown(), reason: error.to_string(), passing }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_and_passwords_are_not_shown() {
        let queue = QueueAddress::parse("postgres://me:se:c@ret@host:5433/db?sslmode=require").unwrap();
        assert_eq!(queue.shown(), "postgres://me@host:5433/db?sslmode=require");
        assert!(queue.full().contains("se:c@ret"));
        assert_eq!(QueueAddress::parse("a/b.sqlite").unwrap(), QueueAddress::File("a/b.sqlite".into()));
        for bad in ["", "mysql://host/db", "redis://u:secret@host"] {
            let error = QueueAddress::parse(bad).unwrap_err();
            assert!(!error.to_string().contains("secret") && error.hint().is_some(), "{error}");
        }
    }
}
