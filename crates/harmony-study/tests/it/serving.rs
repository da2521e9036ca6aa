//! The server: what it acknowledges is on the disk, and what is not genuine is refused.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use harmony_study::log::{Entry, Log, LogLimits, read};
use harmony_study::private::PrivateStudy;
use harmony_study::server::{ServeOptions, Site, serve};
use serde_json::{Value, json};

use crate::fixture::{Study, answer, study};

/// A connection that is kept.
pub struct Client {
    stream: BufReader<TcpStream>,
}

impl Client {
    pub fn to(port: u16) -> std::io::Result<Self> {
        let stream = TcpStream::connect(("127.0.0.1", port))?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(Duration::from_secs(20)))?;
        Ok(Self { stream: BufReader::new(stream) })
    }

    pub fn send(&mut self, method: &str, path: &str, body: &[u8]) -> std::io::Result<(u16, Vec<u8>)> {
        let head = format!("{method} {path} HTTP/1.1\r\nhost: x\r\ncontent-length: {}\r\n\r\n", body.len());
        self.stream.get_mut().write_all(&[head.as_bytes(), body].concat())?;
        let broken = || std::io::Error::other("no response");
        let mut line = String::new();
        self.stream.read_line(&mut line)?;
        let status = line.split(' ').nth(1).and_then(|s| s.parse().ok()).ok_or_else(broken)?;
        let mut length = 0;
        loop {
            line.clear();
            self.stream.read_line(&mut line)?;
            if line == "\r\n" {
                break;
            }
            if line.is_empty() {
                return Err(broken());
            }
            if let Some(value) = line.to_ascii_lowercase().strip_prefix("content-length:") {
                length = value.trim().parse().map_err(|_| broken())?;
            }
        }
        let mut body = vec![0; length];
        self.stream.read_exact(&mut body)?;
        Ok((status, body))
    }

    pub fn post(&mut self, path: &str, value: &Value) -> std::io::Result<(u16, Value)> {
        let (status, body) = self.send("POST", path, value.to_string().as_bytes())?;
        Ok((status, serde_json::from_slice(&body).unwrap_or(Value::Null)))
    }
}

/// A server in a process of its own: this test's program once more.
struct Server {
    child: Child,
    port: u16,
}

impl Server {
    fn start(folder: &Path, open: usize) -> Self {
        let port_file = folder.join("port");
        let _ = std::fs::remove_file(&port_file);
        let child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "serving::child_server", "--nocapture"])
            .env("HARMONY_STUDY_CHILD", folder)
            .env("HARMONY_STUDY_OPEN", open.to_string())
            .stdout(Stdio::null())
            .stderr(Stdio::inherit())
            .spawn()
            .unwrap();
        let end = Instant::now() + Duration::from_secs(20);
        let port = loop {
            if let Some(port) = std::fs::read_to_string(&port_file).ok().and_then(|t| t.trim().parse().ok()) {
                break port;
            }
            assert!(Instant::now() < end, "the server does not start");
            std::thread::sleep(Duration::from_millis(5));
        };
        Self { child, port }
    }

    fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Not a test: what the child process runs.
#[test]
fn child_server() {
    let Some(folder) = std::env::var_os("HARMONY_STUDY_CHILD") else { return };
    let folder = Path::new(&folder);
    let open = std::env::var("HARMONY_STUDY_OPEN").unwrap().parse().unwrap();
    let study = PrivateStudy::load(&folder.join("private")).unwrap();
    let site = Site::open(&folder.join("site"), &study).unwrap();
    let log = Log::open(&folder.join("log.jsonl"), &study, LogLimits::default()).unwrap();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    runtime.block_on(async {
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        harmony_io::write_atomic(&folder.join("port"), listener.local_addr().unwrap().port().to_string().as_bytes())
            .unwrap();
        serve(listener, site, study, log, ServeOptions { open }, std::future::pending()).await;
    });
}

fn posted(study: &PrivateStudy, participant: &str, trial: usize, revision: u32) -> Value {
    let mut answer = answer(study, participant, trial, vec![2, 1, 3]);
    answer.revision = revision;
    json!({ "token": study.token(participant, &answer.trial), "answer": answer })
}

fn stored(study: &Study) -> BTreeSet<(String, String, u32)> {
    read(&study.log(), study.secret())
        .unwrap()
        .into_iter()
        .filter_map(|entry| match entry {
            Entry::Answer { answer, .. } => Some((answer.participant, answer.trial, answer.revision)),
            _ => None,
        })
        .collect()
}

#[test]
fn what_was_acknowledged_survives_kills_at_any_moment() {
    let study = study(3, 4, |_| {});
    let mut acknowledged = BTreeSet::new();
    let (mut posts, mut busy) = (0_usize, Duration::ZERO);
    for round in 0..8_u32 {
        let server = Server::start(study.folder.path(), 0);
        let port = server.port;
        let stop = Arc::new(AtomicBool::new(false));
        let got = Arc::new(Mutex::new(Vec::new()));
        let begun = Instant::now();
        let clients: Vec<_> = (0..32)
            .map(|c| {
                let (stop, got, secret) = (Arc::clone(&stop), Arc::clone(&got), study.secret().clone());
                std::thread::spawn(move || {
                    let Ok(mut client) = Client::to(port) else { return };
                    for i in 0.. {
                        if stop.load(Ordering::Relaxed) {
                            break;
                        }
                        let participant = format!("r{round}-c{c}-{}", i / 4);
                        let body = posted(&secret, &participant, i % 4, 1);
                        match client.post("/api/answer", &body) {
                            Ok((200, said)) => {
                                assert_eq!(said["new"], true);
                                let trial = body["answer"]["trial"].as_str().unwrap().to_owned();
                                got.lock().unwrap().push((participant, trial, 1));
                            }
                            Ok((status, said)) => panic!("{status} {said}"),
                            // Killed: this one may be stored or not.
                            Err(_) => break,
                        }
                    }
                })
            })
            .collect();
        // A moment of its own in each round, from almost none to half a second.
        std::thread::sleep(Duration::from_millis(u64::from(40 + (round * 137) % 400)));
        server.kill();
        busy += begun.elapsed();
        stop.store(true, Ordering::Relaxed);
        for client in clients {
            client.join().unwrap();
        }
        let got = std::mem::take(&mut *got.lock().unwrap());
        posts += got.len();
        acknowledged.extend(got);
        // A torn last line, as a power cut may leave one, is cut off at the next start.
        if round == 3 {
            let mut file = std::fs::OpenOptions::new().append(true).open(study.log()).unwrap();
            file.write_all(b"{\"kind\":\"answer\",\"answer\":{\"stu").unwrap();
        }
        let stored = stored(&study);
        let lost: Vec<_> = acknowledged.difference(&stored).collect();
        assert!(lost.is_empty(), "{} of {} lost: {:?}", lost.len(), acknowledged.len(), lost.first());
    }
    let rate = posts as f64 / busy.as_secs_f64();
    eprintln!("{posts} acknowledged in {busy:.1?}, clients and server on the same cores: {rate:.0} a second");
    assert!(posts >= 400, "only {posts} posts: the test has not tried anything");
    // Each was stored once.
    let entries = read(&study.log(), study.secret()).unwrap();
    assert_eq!(entries.len(), 1 + stored(&study).len());
}

#[test]
fn forged_doubled_and_broken_submissions_are_refused() {
    let study = study(3, 2, |_| {});
    let secret = study.secret();
    let server = Server::start(study.folder.path(), 0);
    let mut client = Client::to(server.port).unwrap();
    let good = posted(secret, "anna-0001", 0, 1);
    let mut expect = |body: &Value, status: u16, word: &str| {
        let (got, said) = client.post("/api/answer", body).unwrap();
        assert_eq!(got, status, "{said}");
        assert!(said.to_string().contains(word), "{said}");
    };
    // Forged: no token, another trial's, another participant's.
    let mut body = good.clone();
    body["token"] = json!("00000000000000000000000000000000");
    expect(&body, 403, "signature");
    body["token"] = json!(secret.token("anna-0001", &secret.trials[1].id));
    expect(&body, 403, "signature");
    body = good.clone();
    body["answer"]["participant"] = json!("bert-0001");
    expect(&body, 403, "signature");
    // Broken: ranks twice, too few, out of range; another order of panels; other fields; another study.
    for ranks in [json!([1, 1, 2]), json!([1, 2]), json!([0, 1, 2]), json!([1, 2, 4]), json!([1, 2, 3, 4])] {
        body = good.clone();
        body["answer"]["ranks"] = ranks;
        expect(&body, 400, "every rank");
    }
    body = good.clone();
    body["answer"]["order"].as_array_mut().unwrap().rotate_left(1);
    expect(&body, 400, "order");
    body = good.clone();
    body["answer"]["email"] = json!("anna@example.org");
    expect(&body, 400, "email");
    body = good.clone();
    body["answer"]["version"] = json!("0");
    expect(&body, 409, "another study");
    body = good.clone();
    body["answer"]["revision"] = json!(51);
    expect(&body, 400, "range");
    // Stored once, however often it is sent; another content of the same revision is refused.
    expect(&good, 200, "\"new\":true");
    expect(&good, 200, "\"new\":false");
    body = good.clone();
    body["answer"]["ranks"] = json!([3, 1, 2]);
    expect(&body, 409, "answered already");
    body["answer"]["revision"] = json!(2);
    expect(&body, 200, "\"new\":true");
    expect(&good, 409, "answered already");
    // After handing in, nothing more.
    let key = secret.invitation("anna-0001");
    let who = json!({ "study": "test-study", "participant": "anna-0001", "key": key });
    let (status, said) = client.post("/api/begin", &who).unwrap();
    assert_eq!((status, &said["answers"][&secret.trials[0].id]["revision"]), (200, &json!(2)));
    assert_eq!(said["tokens"][&secret.trials[1].id], json!(secret.token("anna-0001", &secret.trials[1].id)));
    assert_eq!(client.post("/api/finish", &who).unwrap().0, 200);
    assert_eq!(client.post("/api/finish", &who).unwrap().1["new"], false);
    let (status, said) = client.post("/api/answer", &posted(secret, "anna-0001", 1, 1)).unwrap();
    assert_eq!(status, 409, "{said}");
    // Invitations.
    let mut other = who.clone();
    other["participant"] = json!("bert-0001");
    assert_eq!(client.post("/api/begin", &other).unwrap().0, 403);
    assert_eq!(client.post("/api/finish", &other).unwrap().0, 403);
    assert_eq!(client.post("/api/enrol", &json!({})).unwrap().0, 403);
    // Sizes are bounded.
    let mut big = Client::to(server.port).unwrap();
    let refused = big.send("POST", "/api/answer", &vec![b'x'; 20_000]);
    assert!(refused.is_err() || refused.unwrap().0 == 413);
    // Only the page's own files.
    let mut client = Client::to(server.port).unwrap();
    let page = client.send("GET", "/", b"").unwrap();
    assert!(page.0 == 200 && String::from_utf8_lossy(&page.1).contains("test-study"));
    let name = format!("/pictures/{}.jpg", secret.trials[0].id);
    assert_eq!(client.send("GET", &name, b"").unwrap().0, 200);
    for path in [
        "/pictures/../../private/study.json",
        "/pictures/%2e%2e%2f%2e%2e%2fprivate%2fstudy.json",
        "/private/study.json",
    ] {
        let (status, body) = client.send("GET", path, b"").unwrap();
        assert_eq!(status, 404, "{path}");
        assert!(!String::from_utf8_lossy(&body).contains(&secret.secret));
    }
    server.kill();
    // What is stored is the answers alone: no address, no agent, no time.
    let log = std::fs::read_to_string(study.log()).unwrap();
    assert_eq!(log.lines().count(), 4);
    for line in log.lines().skip(1) {
        let value: Value = serde_json::from_str(line).unwrap();
        let keys: Vec<&String> = value.as_object().unwrap().keys().collect();
        assert!(
            keys.iter().all(|k| ["kind", "answer", "via", "participant", "chain"].contains(&k.as_str())),
            "{keys:?}"
        );
        assert!(!line.contains("127.0.0.1"));
    }
}

#[test]
fn an_open_study_takes_so_many_people_and_no_more() {
    let study = study(3, 2, |_| {});
    let server = Server::start(study.folder.path(), 2);
    let mut client = Client::to(server.port).unwrap();
    assert_eq!(
        serde_json::from_slice::<Value>(&client.send("GET", "/api/study", b"").unwrap().1).unwrap()["open"],
        true
    );
    for _ in 0..2 {
        let (status, said) = client.post("/api/enrol", &json!({})).unwrap();
        assert_eq!(status, 200);
        let code = said["participant"].as_str().unwrap();
        assert!(study.secret().invited(code, said["key"].as_str().unwrap()));
        assert_eq!(client.post("/api/answer", &posted(study.secret(), code, 0, 1)).unwrap().0, 200);
    }
    assert_eq!(client.post("/api/enrol", &json!({})).unwrap().0, 403);
}

#[test]
fn a_log_that_was_changed_or_belongs_elsewhere_is_refused() {
    let first = study(3, 2, |_| {});
    let log = Log::open(&first.log(), first.secret(), LogLimits::default()).unwrap();
    // Nobody else writes meanwhile.
    assert!(
        Log::open(&first.log(), first.secret(), LogLimits::default())
            .unwrap_err()
            .to_string()
            .contains("another program")
    );
    for (i, participant) in ["anna-0001", "bert-0001", "cleo-0001"].iter().enumerate() {
        let answer = answer(first.secret(), participant, i % 2, vec![1, 2, 3]);
        log.append_blocking(Entry::Answer { answer, via: harmony_study::log::Via::Server }).unwrap();
    }
    log.close();
    let whole = std::fs::read_to_string(first.log()).unwrap();
    let refused = |text: &str, line: usize| {
        std::fs::write(first.log(), text).unwrap();
        let error = Log::open(&first.log(), first.secret(), LogLimits::default()).unwrap_err();
        assert!(error.to_string().contains(&format!("line {line} ")), "{error}");
        assert_eq!(std::fs::read_to_string(first.log()).unwrap(), text, "a refused log stays as it is");
    };
    // A changed rank, a missing line, two lines exchanged.
    refused(&whole.replacen("[1,2,3]", "[2,1,3]", 1), 2);
    let lines: Vec<&str> = whole.split_inclusive('\n').collect();
    refused(&[lines[0], lines[2], lines[3]].concat(), 2);
    refused(&[lines[0], lines[1], lines[3], lines[2]].concat(), 3);
    std::fs::write(first.log(), &whole).unwrap();
    let other = study(3, 2, |o| o.study = "other-study".to_owned());
    let error = Log::open(&first.log(), other.secret(), LogLimits::default()).unwrap_err();
    assert!(error.to_string().contains("of study test-study"), "{error}");
    assert!(Site::open(&first.site(), other.secret()).unwrap_err().to_string().contains("of study test-study"));
}

#[test]
fn limits_of_the_log_hold() {
    let study = study(3, 2, |_| {});
    let log = Log::open(&study.log(), study.secret(), LogLimits { bytes: 1 << 30, participants: 2 }).unwrap();
    let mut outcomes = BTreeMap::new();
    for code in ["anna-0001", "bert-0001", "cleo-0001", "anna-0001"] {
        let entry = answer(study.secret(), code, 1, vec![1, 2, 3]);
        let outcome = log.append_blocking(Entry::Answer { answer: entry, via: harmony_study::log::Via::Server });
        outcomes.entry(code).or_insert(outcome.is_ok());
    }
    assert_eq!(outcomes, BTreeMap::from([("anna-0001", true), ("bert-0001", true), ("cleo-0001", false)]));
    log.close();
    let log = Log::open(&study.log(), study.secret(), LogLimits { bytes: 100, participants: 9 }).unwrap();
    let entry = answer(study.secret(), "anna-0001", 0, vec![1, 2, 3]);
    let full = log.append_blocking(Entry::Answer { answer: entry, via: harmony_study::log::Via::Server });
    assert_eq!(full, Err(harmony_study::log::NotStored::Full));
}
