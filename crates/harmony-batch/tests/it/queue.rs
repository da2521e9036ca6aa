//! Databases that are no queue, and what a second call changes.

use harmony_batch::queue::{Ended, JobResult, NewJob};
use harmony_batch::status::write_table;
use harmony_batch::{BatchError, Queue, QueueAddress, SetFolder};
use sqlx::Executor as _;

use crate::common::new_set;

async fn file_with(path: &std::path::Path, statements: &[&str]) {
    sqlx::any::install_default_drivers();
    let url = format!("sqlite://{}?mode=rwc", path.display());
    let pool = sqlx::AnyPool::connect(&url).await.unwrap();
    for statement in statements {
        pool.execute(sqlx::AssertSqlSafe((*statement).to_owned())).await.unwrap();
    }
    pool.close().await;
}

#[tokio::test]
async fn a_database_of_another_schema_is_refused_and_left_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let cases: [(&str, &[&str], &str); 4] = [
        ("other", &["CREATE TABLE photos (id INTEGER)", "INSERT INTO photos VALUES (7)"], "a table photos"),
        (
            "later",
            &["CREATE TABLE harmony_queue (version BIGINT)", "INSERT INTO harmony_queue VALUES (99)"],
            "version 99",
        ),
        ("half", &["CREATE TABLE harmony_jobs (id INTEGER)"], "harmony_jobs without harmony_queue"),
        ("same name", &["CREATE TABLE harmony_queue (color TEXT)"], "not ours"),
    ];
    for (name, statements, said) in cases {
        let path = folder.path().join(name);
        file_with(&path, statements).await;
        let before = std::fs::read(&path).unwrap();
        let error = Queue::create(&QueueAddress::File(path.clone()), 1).await.unwrap_err();
        assert!(error.to_string().contains(said) && error.hint().is_some(), "{name}: {error}");
        assert!(matches!(error, BatchError::Schema { .. }), "{name}: {error:?}");
        assert_eq!(tables(&path).await, tables_of(&before, folder.path()).await, "{name}");
    }
    let text = folder.path().join("text");
    std::fs::write(&text, "this is a letter, and long enough to be mistaken for something else. ".repeat(20)).unwrap();
    let error = Queue::create(&QueueAddress::File(text.clone()), 1).await.unwrap_err();
    assert!(matches!(error, BatchError::Schema { .. }), "{error:?}");
    assert!(std::fs::read_to_string(&text).unwrap().starts_with("this is a letter"));
    let error = Queue::open(&QueueAddress::File(folder.path().join("none")), 1).await.unwrap_err();
    assert!(error.to_string().contains("no such file"), "{error}");
    assert!(!folder.path().join("none").exists());
}

#[tokio::test]
async fn the_table_of_a_large_set_has_each_scene_once_whatever_lies_between() {
    let folder = tempfile::tempdir().unwrap();
    let queue = Queue::create(&QueueAddress::File(folder.path().join("q")), 2).await.unwrap();
    let set = queue.put_set(&new_set("set")).await.unwrap();
    let other = queue.put_set(&new_set("other")).await.unwrap();
    let scene = |i: i64| format!("room_{:05}", (i * 7919) % 25_000);
    let jobs = |range: std::ops::Range<i64>| {
        range
            .map(|i| NewJob { scene: scene(i), photo: "p.jpg".into(), hash: i.to_string(), priority: 0 })
            .collect::<Vec<_>>()
    };
    let out = SetFolder::make(&folder.path().join("set"), None, &[], "", "test").unwrap();
    write_table(&queue, &set, &out).await.unwrap();
    let table = || std::fs::read_to_string(out.path().join("scenes.csv")).unwrap();
    assert_eq!(table().lines().count(), 1, "an empty set has a head alone");
    // More than one range of numbers is read at a time, another set's among them.
    queue.enqueue(set.id, &jobs(0..9_000)).await.unwrap();
    queue.enqueue(other.id, &jobs(0..11_000)).await.unwrap();
    queue.enqueue(set.id, &jobs(9_000..25_000)).await.unwrap();
    let job = queue.claim(&set, "one").await.unwrap().unwrap();
    queue.finish(&job, &Ended::Done, Some(0.5)).await.unwrap();
    write_table(&queue, &set, &out).await.unwrap();
    let text = table();
    let names: Vec<&str> = text.lines().skip(1).filter_map(|line| line.split(',').next()).collect();
    let wanted: Vec<String> = (0..25_000).map(|i| format!("room_{i:05}")).collect();
    assert!(names.iter().eq(wanted.iter()), "{} lines", names.len());
    let of = |state: &str| text.lines().filter(|line| line.split(',').nth(1) == Some(state)).count();
    assert_eq!((of("done"), of("queued")), (1, 24_999));
    assert_eq!(queue.scenes(set.id, "done", 10).await.unwrap().len(), 1);
    assert_eq!(queue.scenes(set.id, "", 10).await.unwrap()[0].scene, scene(0), "the last to end goes first");
}

async fn tables(path: &std::path::Path) -> Vec<String> {
    use sqlx::Row as _;
    let pool = sqlx::AnyPool::connect(&format!("sqlite://{}?mode=ro", path.display())).await.unwrap();
    let rows = sqlx::query("SELECT sql FROM sqlite_master ORDER BY name").fetch_all(&pool).await.unwrap();
    rows.iter().map(|row| row.get::<String, _>(0)).collect()
}

async fn tables_of(bytes: &[u8], folder: &std::path::Path) -> Vec<String> {
    let copy = folder.join("copy");
    std::fs::write(&copy, bytes).unwrap();
    tables(&copy).await
}

#[tokio::test]
async fn a_server_that_is_not_there_is_named_without_its_password() {
    let address = QueueAddress::parse("postgres://me:secret@127.0.0.1:1/none").unwrap();
    let error = Queue::create(&address, 1).await.unwrap_err();
    assert!(error.to_string().contains("127.0.0.1:1/none") && !error.to_string().contains("secret"), "{error}");
    assert!(error.hint().is_some());
}

#[tokio::test]
async fn ends_told_twice_or_by_one_who_lost_the_job_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let queue = Queue::create(&QueueAddress::File(folder.path().join("q")), 2).await.unwrap();
    let mut new = new_set("set");
    new.lease_ms = 1;
    let set = queue.put_set(&new).await.unwrap();
    new.attempts = 9;
    assert_eq!(queue.put_set(&new).await.unwrap().attempts, 2, "a set that is there stays as it is");
    let job = |scene: &str| NewJob { scene: scene.into(), photo: "p".into(), hash: scene.into(), priority: 0 };
    assert_eq!(queue.enqueue(set.id, &[job("it's \"odd\""), job("b")]).await.unwrap(), 2);
    assert_eq!(queue.enqueue(set.id, &[job("b"), job("c")]).await.unwrap(), 1);
    let first = queue.claim(&set, "one").await.unwrap().unwrap();
    assert_eq!(first.scene, "it's \"odd\"");
    tokio::time::sleep(std::time::Duration::from_millis(10)).await;
    assert_eq!(queue.tend().await.unwrap(), ["it's \"odd\""]);
    let again = queue.claim(&set, "two").await.unwrap().unwrap();
    assert_eq!((again.id, again.token), (first.id, first.token + 1));
    assert_eq!(queue.finish(&first, &Ended::Done, None).await.unwrap(), JobResult::NotOurs);
    assert_eq!(queue.finish(&again, &Ended::Done, Some(1.5)).await.unwrap(), JobResult::Kept);
    assert_eq!(queue.finish(&again, &Ended::Done, None).await.unwrap(), JobResult::NotOurs);
    let rows = queue.scenes(set.id, "done", 10).await.unwrap();
    assert_eq!((rows.len(), rows[0].ends, rows[0].bill_usd), (1, 1, Some(1.5)));
    assert_eq!(queue.names(set.id).await.unwrap().len(), 3);
}
