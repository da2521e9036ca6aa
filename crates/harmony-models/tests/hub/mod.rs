//! A model hub on loopback: one port answers as the hub does, another one as the storage that it sends clients to.
#![allow(clippy::unwrap_used, reason = "support of tests")]

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};

/// What the storage does with one request; the last one holds for all that follow.
#[derive(Debug, Clone)]
pub enum Storage {
    /// Serves, ranges and all.
    Serve,
    /// Closes after so many bytes of the body.
    Cut(usize),
    /// Falls silent after so many bytes of the body.
    Stall(usize),
    /// Sends a few bytes at a time, with pauses.
    Slow(usize),
    /// Knows no ranges.
    WholeOnly,
    /// Honours the range whatever `If-Range` says.
    CarelessRange,
    /// Refuses with a status and headers.
    Refuse(u16, Vec<(&'static str, String)>),
    /// Announces so many bytes and sends none.
    Announce(usize),
}

/// What the hub's own port does.
#[derive(Debug, Clone)]
pub enum Front {
    /// Sends clients to the storage.
    Redirect,
    /// Refuses with a status and headers.
    Refuse(u16, Vec<(&'static str, String)>),
    /// Refuses without this token, else redirects.
    Gated(String),
    /// Sends clients in circles.
    Circle,
}

#[derive(Debug, Clone)]
pub struct Seen {
    /// `hub` or `storage`.
    pub port: &'static str,
    pub path: String,
    pub headers: Vec<(String, String)>,
}

impl Seen {
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(k, _)| k == name).map(|(_, v)| v.as_str())
    }
}

pub struct State {
    pub body: Vec<u8>,
    pub etag: Option<String>,
    /// `X-Linked-Etag` and `X-Repo-Commit` of the hub.
    pub linked: Option<String>,
    pub commit: Option<String>,
    pub front: Front,
    pub storage: VecDeque<Storage>,
    pub seen: Vec<Seen>,
}

/// A running hub; it ends with the test.
pub struct FakeHub {
    pub state: Arc<Mutex<State>>,
    pub port: u16,
    tasks: Vec<tokio::task::JoinHandle<()>>,
}

impl Drop for FakeHub {
    fn drop(&mut self) {
        self.tasks.iter().for_each(tokio::task::JoinHandle::abort);
    }
}

impl FakeHub {
    pub async fn start(body: &[u8]) -> Self {
        let state = Arc::new(Mutex::new(State {
            body: body.to_vec(),
            etag: Some("\"first\"".to_owned()),
            linked: None,
            commit: None,
            front: Front::Redirect,
            storage: VecDeque::from([Storage::Serve]),
            seen: Vec::new(),
        }));
        let storage = TcpListener::bind(("127.0.0.1", 0)).await.unwrap();
        let storage_port = storage.local_addr().unwrap().port();
        let hub = TcpListener::bind(("127.0.0.1", 0)).await.unwrap();
        let port = hub.local_addr().unwrap().port();
        let tasks =
            vec![accept(storage, Arc::clone(&state), None), accept(hub, Arc::clone(&state), Some(storage_port))];
        Self { state, port, tasks }
    }

    pub fn set(&self, change: impl FnOnce(&mut State)) {
        change(&mut self.state.lock().unwrap());
    }

    /// What the storage does, one request after the other.
    pub fn storage(&self, plays: impl IntoIterator<Item = Storage>) {
        self.set(|s| s.storage = plays.into_iter().collect());
    }

    pub fn seen(&self, port: &str) -> Vec<Seen> {
        self.state.lock().unwrap().seen.iter().filter(|s| s.port == port).cloned().collect()
    }
}

fn accept(listener: TcpListener, state: Arc<Mutex<State>>, redirect_to: Option<u16>) -> tokio::task::JoinHandle<()> {
    tokio::spawn(async move {
        while let Ok((stream, _)) = listener.accept().await {
            let state = Arc::clone(&state);
            tokio::spawn(async move {
                // A client that goes away is part of the tests.
                let _ = serve(stream, &state, redirect_to).await;
            });
        }
    })
}

async fn serve(mut stream: TcpStream, state: &Mutex<State>, redirect_to: Option<u16>) -> std::io::Result<()> {
    let mut request = Vec::new();
    while !request.ends_with(b"\r\n\r\n") {
        let mut byte = [0];
        if stream.read(&mut byte).await? == 0 {
            return Ok(());
        }
        request.push(byte[0]);
    }
    let text = String::from_utf8_lossy(&request).into_owned();
    let mut lines = text.lines();
    let path = lines.next().and_then(|l| l.split(' ').nth(1)).unwrap_or_default().to_owned();
    let headers: Vec<(String, String)> =
        lines.filter_map(|l| l.split_once(": ")).map(|(k, v)| (k.to_lowercase(), v.to_owned())).collect();
    let seen = Seen { port: if redirect_to.is_some() { "hub" } else { "storage" }, path, headers };
    match redirect_to {
        Some(port) => front(&mut stream, state, &seen, port).await?,
        None => storage(&mut stream, state, &seen).await?,
    }
    stream.flush().await?;
    stream.shutdown().await
}

fn head(status: u16, headers: &[(&str, String)], length: usize) -> String {
    let mut head = format!("HTTP/1.1 {status} Whatever\r\nconnection: close\r\ncontent-length: {length}\r\n");
    for (key, value) in headers {
        write!(head, "{key}: {value}\r\n").unwrap();
    }
    head + "\r\n"
}

async fn front(stream: &mut TcpStream, state: &Mutex<State>, seen: &Seen, storage_port: u16) -> std::io::Result<()> {
    let answer = {
        let mut state = state.lock().unwrap();
        state.seen.push(seen.clone());
        let location = match &state.front {
            Front::Refuse(status, headers) => Err((*status, headers.clone())),
            Front::Gated(token) if seen.header("authorization") != Some(&format!("Bearer {token}")) => {
                Err((401, vec![("x-error-code", "GatedRepo".to_owned())]))
            }
            Front::Circle => Ok(seen.path.clone()),
            Front::Redirect | Front::Gated(_) => {
                Ok(format!("http://127.0.0.1:{storage_port}/blob?X-Signature=canary-signature"))
            }
        };
        match location {
            Err((status, headers)) => head(status, &headers, 0),
            Ok(location) => {
                let mut headers = vec![("location", location), ("x-linked-size", state.body.len().to_string())];
                headers.extend(state.linked.clone().map(|tag| ("x-linked-etag", tag)));
                headers.extend(state.commit.clone().map(|commit| ("x-repo-commit", commit)));
                head(302, &headers, 0)
            }
        }
    };
    stream.write_all(answer.as_bytes()).await
}

async fn storage(stream: &mut TcpStream, state: &Mutex<State>, seen: &Seen) -> std::io::Result<()> {
    let (play, body, etag) = {
        let mut state = state.lock().unwrap();
        state.seen.push(seen.clone());
        let play = if state.storage.len() > 1 { state.storage.pop_front() } else { state.storage.front().cloned() };
        (play.unwrap_or(Storage::Serve), state.body.clone(), state.etag.clone())
    };
    if let Storage::Refuse(status, headers) = &play {
        return stream.write_all(head(*status, headers, 0).as_bytes()).await;
    }
    if let Storage::Announce(length) = play {
        return stream.write_all(head(200, &[], length).as_bytes()).await;
    }
    let range = seen.header("range").and_then(|r| r.strip_prefix("bytes=")?.strip_suffix('-')?.parse::<usize>().ok());
    let same = match seen.header("if-range") {
        Some(tag) => etag.as_deref() == Some(tag) || matches!(play, Storage::CarelessRange),
        None => true,
    };
    let mut headers: Vec<(&str, String)> = etag.into_iter().map(|tag| ("etag", tag)).collect();
    let start = range.filter(|_| same && !matches!(play, Storage::WholeOnly));
    let part = match start {
        Some(start) if start >= body.len() => {
            headers.push(("content-range", format!("bytes */{}", body.len())));
            return stream.write_all(head(416, &headers, 0).as_bytes()).await;
        }
        Some(start) => {
            headers.push(("content-range", format!("bytes {start}-{}/{}", body.len() - 1, body.len())));
            stream.write_all(head(206, &headers, body.len() - start).as_bytes()).await?;
            &body[start..]
        }
        None => {
            stream.write_all(head(200, &headers, body.len()).as_bytes()).await?;
            &body[..]
        }
    };
    match play {
        Storage::Cut(n) => stream.write_all(&part[..n.min(part.len())]).await,
        Storage::Stall(n) => {
            stream.write_all(&part[..n.min(part.len())]).await?;
            stream.flush().await?;
            tokio::time::sleep(Duration::from_mins(1)).await;
            Ok(())
        }
        Storage::Slow(n) => {
            for some in part.chunks(n) {
                stream.write_all(some).await?;
                stream.flush().await?;
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
            Ok(())
        }
        _ => stream.write_all(part).await,
    }
}
