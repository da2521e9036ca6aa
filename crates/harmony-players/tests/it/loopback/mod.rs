//! A tiny HTTP server on loopback that answers as a test tells it to.
#![allow(dead_code, clippy::unwrap_used, reason = "support of tests; each program uses its part")]

use std::fmt::Write as _;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use harmony_players::http::{Auth, Http, HttpLimits, ServiceOptions};
use serde_json::Value;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};

/// A request that came in.
#[derive(Debug, Clone)]
pub struct Seen {
    pub method: String,
    pub path: String,
    pub headers: Vec<(String, String)>,
    pub body: Vec<u8>,
}

impl Seen {
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(k, _)| k.eq_ignore_ascii_case(name)).map(|(_, v)| v.as_str())
    }

    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or(Value::Null)
    }
}

/// What the server does.
#[derive(Debug, Clone)]
pub enum Play {
    /// Answers.
    Answer(u16, Vec<(String, String)>, Vec<u8>),
    /// Says nothing.
    Silence,
    /// Announces a body of this many bytes, sends what is given and then nothing more.
    Stall(u64, Vec<u8>),
    /// Announces a body of this many bytes, sends what is given and closes.
    CutOff(u64, Vec<u8>),
    /// Sends zeros in chunks without end.
    Endless,
    /// Closes at once.
    Close,
}

pub fn json(status: u16, body: &Value) -> Play {
    Play::Answer(status, vec![("content-type".into(), "application/json".into())], body.to_string().into_bytes())
}

pub fn bytes(body: Vec<u8>) -> Play {
    Play::Answer(200, vec![], body)
}

/// A running server; it ends with the test.
pub struct Loopback {
    pub port: u16,
    seen: Arc<Mutex<Vec<Seen>>>,
    /// Bytes of bodies that were sent.
    pub sent: Arc<AtomicU64>,
    task: tokio::task::JoinHandle<()>,
}

impl Drop for Loopback {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl Loopback {
    pub async fn start(play: impl Fn(&Seen) -> Play + Send + Sync + 'static) -> Self {
        let listener = TcpListener::bind(("127.0.0.1", 0)).await.unwrap();
        let port = listener.local_addr().unwrap().port();
        let (seen, sent) = (Arc::new(Mutex::new(Vec::new())), Arc::new(AtomicU64::new(0)));
        let play = Arc::new(play);
        let task = tokio::spawn({
            let (seen, sent) = (Arc::clone(&seen), Arc::clone(&sent));
            async move {
                while let Ok((stream, _)) = listener.accept().await {
                    let (seen, sent, play) = (Arc::clone(&seen), Arc::clone(&sent), Arc::clone(&play));
                    tokio::spawn(async move {
                        // A client that goes away is part of the tests.
                        let _ = serve(stream, &seen, &sent, &*play).await;
                    });
                }
            }
        });
        Self { port, seen, sent, task }
    }

    /// Always the same.
    pub async fn always(play: Play) -> Self {
        Self::start(move |_| play.clone()).await
    }

    pub fn address(&self) -> String {
        format!("http://127.0.0.1:{}", self.port)
    }

    pub fn seen(&self) -> Vec<Seen> {
        self.seen.lock().unwrap().clone()
    }

    /// A service here, without a key.
    pub fn service(&self, path: &str) -> ServiceOptions {
        self.service_with(path, Auth::None)
    }

    pub fn service_with(&self, path: &str, auth: Auth) -> ServiceOptions {
        ServiceOptions {
            player: "the player".into(),
            address: format!("{}{path}", self.address()),
            auth,
            limits: HttpLimits {
                silence: Duration::from_millis(400),
                total: Duration::from_secs(20),
                ..HttpLimits::default()
            },
            remedy: "do this".into(),
        }
    }
}

pub fn http() -> Http {
    Http::new(None, Duration::from_secs(2)).unwrap()
}

async fn serve(
    mut stream: TcpStream,
    seen: &Mutex<Vec<Seen>>,
    sent: &AtomicU64,
    play: &(dyn Fn(&Seen) -> Play + Send + Sync),
) -> std::io::Result<()> {
    let Some(request) = read_request(&mut stream).await? else { return Ok(()) };
    seen.lock().unwrap().push(request.clone());
    let head = |status: u16, headers: &[(String, String)], length: Option<u64>| {
        let mut head = format!("HTTP/1.1 {status} Whatever\r\nconnection: close\r\n");
        for (k, v) in headers {
            write!(head, "{k}: {v}\r\n").unwrap();
        }
        match length {
            Some(length) => write!(head, "content-length: {length}\r\n\r\n").unwrap(),
            None => head.push_str("transfer-encoding: chunked\r\n\r\n"),
        }
        head
    };
    match play(&request) {
        Play::Answer(status, headers, body) => {
            stream.write_all(head(status, &headers, Some(body.len() as u64)).as_bytes()).await?;
            stream.write_all(&body).await?;
            sent.fetch_add(body.len() as u64, Ordering::Relaxed);
        }
        Play::Silence => tokio::time::sleep(Duration::from_mins(1)).await,
        Play::Stall(length, body) => {
            stream.write_all(head(200, &[], Some(length)).as_bytes()).await?;
            stream.write_all(&body).await?;
            stream.flush().await?;
            tokio::time::sleep(Duration::from_mins(1)).await;
        }
        Play::CutOff(length, body) => {
            stream.write_all(head(200, &[], Some(length)).as_bytes()).await?;
            stream.write_all(&body).await?;
        }
        Play::Endless => {
            stream.write_all(head(200, &[], None).as_bytes()).await?;
            let block = vec![0_u8; 1 << 16];
            loop {
                stream.write_all(format!("{:x}\r\n", block.len()).as_bytes()).await?;
                stream.write_all(&block).await?;
                stream.write_all(b"\r\n").await?;
                sent.fetch_add(block.len() as u64, Ordering::Relaxed);
            }
        }
        Play::Close => {}
    }
    stream.flush().await?;
    stream.shutdown().await
}

async fn read_request(stream: &mut TcpStream) -> std::io::Result<Option<Seen>> {
    let mut buffer = Vec::new();
    let mut block = [0; 8192];
    let end = loop {
        let n = stream.read(&mut block).await?;
        if n == 0 {
            return Ok(None);
        }
        buffer.extend_from_slice(&block[..n]);
        if let Some(at) = buffer.windows(4).position(|w| w == b"\r\n\r\n") {
            break at;
        }
        if buffer.len() > 1 << 20 {
            return Ok(None);
        }
    };
    let head = String::from_utf8_lossy(&buffer[..end]).into_owned();
    let mut lines = head.split("\r\n");
    let mut first = lines.next().unwrap_or_default().split(' ');
    let (method, path) = (first.next().unwrap_or_default().to_owned(), first.next().unwrap_or_default().to_owned());
    let headers: Vec<(String, String)> =
        lines.filter_map(|line| line.split_once(": ")).map(|(k, v)| (k.to_lowercase(), v.to_owned())).collect();
    let length: usize =
        headers.iter().find(|(k, _)| k == "content-length").and_then(|(_, v)| v.parse().ok()).unwrap_or(0);
    let mut body = buffer[end + 4..].to_vec();
    while body.len() < length {
        let n = stream.read(&mut block).await?;
        if n == 0 {
            break;
        }
        body.extend_from_slice(&block[..n]);
    }
    Ok(Some(Seen { method, path, headers, body }))
}
