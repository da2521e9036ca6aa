//! A small HTTP/1.1 server that can also misbehave: cut off, stall, reset, never end.
//!
//! A library would not let an answer be wrong in these ways; what is needed of the protocol is little.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};

/// Longest head of a request, bytes.
const MAX_HEAD: usize = 64 << 10;
/// Largest body of a request, bytes; Gemini's limit is 20 MB, OpenAI's about 50 (image-editor sheet, sections 1 and 2).
const MAX_BODY: usize = 64 << 20;
/// Longest time that a silent or stalled answer is held.
const HOLD: Duration = Duration::from_secs(30);

/// A request that came in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Request {
    /// `GET` or `POST`.
    pub method: String,
    /// Path without the query.
    pub path: String,
    /// Headers, names in small letters.
    pub headers: Vec<(String, String)>,
    /// Body.
    pub body: Vec<u8>,
}

impl Request {
    /// A header's value.
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
    }
}

/// How an answer is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Delivery {
    /// As it should be.
    #[default]
    Whole,
    /// In so many pieces with a pause after each.
    Slow(u32, Duration),
    /// This share of the body (of 256), then the connection is closed in order.
    CutOff(u8),
    /// This share of the body (of 256), then nothing more.
    Stall(u8),
    /// This share of the body (of 256), then a reset.
    Reset(u8),
    /// Nothing at all.
    Silence,
    /// The connection is closed before a byte is sent.
    Close,
    /// A body of so many zeros in place of the answer's, without a length.
    Endless(u64),
}

/// An answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reply {
    /// Status.
    pub status: u16,
    /// Headers beside the length.
    pub headers: Vec<(String, String)>,
    /// Body.
    pub body: Arc<Vec<u8>>,
    /// How it is sent.
    pub delivery: Delivery,
}

impl Reply {
    /// JSON.
    pub fn json(status: u16, body: &serde_json::Value) -> Self {
        Self::bytes(status, "application/json", body.to_string().into_bytes())
    }

    /// Bytes of a type.
    pub fn bytes(status: u16, kind: &str, body: Vec<u8>) -> Self {
        let headers = vec![("content-type".to_owned(), kind.to_owned())];
        Self { status, headers, body: Arc::new(body), delivery: Delivery::Whole }
    }

    /// With a further header.
    #[must_use]
    #[expect(clippy::needless_pass_by_value, reason = "numbers and texts alike")]
    pub fn header(mut self, name: &str, value: impl ToString) -> Self {
        self.headers.push((name.to_owned(), value.to_string()));
        self
    }
}

/// Reads one request; `None` when the connection ends before one begins.
async fn read(stream: &mut TcpStream, buffer: &mut Vec<u8>) -> io::Result<Option<Request>> {
    let mut block = vec![0; 32 << 10];
    let end = loop {
        if let Some(at) = buffer.windows(4).position(|w| w == b"\r\n\r\n") {
            break at;
        }
        if buffer.len() > MAX_HEAD {
            return Err(io::Error::other("the head is too long"));
        }
        let n = stream.read(&mut block).await?;
        if n == 0 {
            return Ok(None);
        }
        buffer.extend_from_slice(&block[..n]);
    };
    let head = String::from_utf8_lossy(&buffer[..end]).into_owned();
    let mut lines = head.split("\r\n");
    let mut first = lines.next().unwrap_or_default().split(' ');
    let method = first.next().unwrap_or_default().to_owned();
    let path = first.next().unwrap_or_default().split('?').next().unwrap_or_default().to_owned();
    let headers: Vec<(String, String)> = lines
        .filter_map(|line| line.split_once(':'))
        .map(|(k, v)| (k.trim().to_lowercase(), v.trim().to_owned()))
        .collect();
    let length =
        headers.iter().find(|(k, _)| k == "content-length").and_then(|(_, v)| v.parse::<usize>().ok()).unwrap_or(0);
    if length > MAX_BODY {
        return Err(io::Error::other("the body is too large"));
    }
    let mut body = buffer.split_off(end + 4);
    buffer.clear();
    while body.len() < length {
        let n = stream.read(&mut block).await?;
        if n == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        body.extend_from_slice(&block[..n]);
    }
    // What follows belongs to the next request of this connection.
    *buffer = body.split_off(length);
    Ok(Some(Request { method, path, headers, body }))
}

/// Sends an answer; whether it went out whole and the connection can be used again.
async fn send(stream: &mut TcpStream, reply: &Reply) -> io::Result<bool> {
    let mut head = format!("HTTP/1.1 {} Studio\r\n", reply.status);
    for (k, v) in &reply.headers {
        head.extend([k, ": ", v, "\r\n"]);
    }
    if matches!(reply.delivery, Delivery::Endless(_)) {
        head.push_str("connection: close\r\n\r\n");
    } else {
        head.push_str(&format!("content-length: {}\r\n\r\n", reply.body.len()));
    }
    let body = reply.body.as_slice();
    let share = |of: u8| &body[..body.len() * usize::from(of) / 256];
    match reply.delivery {
        Delivery::Whole => {
            stream.write_all(head.as_bytes()).await?;
            stream.write_all(body).await?;
            stream.flush().await?;
            return Ok(true);
        }
        Delivery::Slow(pieces, pause) => {
            stream.write_all(head.as_bytes()).await?;
            for piece in body.chunks(body.len().div_ceil(pieces.max(1) as usize).max(1)) {
                stream.write_all(piece).await?;
                stream.flush().await?;
                tokio::time::sleep(pause).await;
            }
            return Ok(true);
        }
        Delivery::CutOff(of) => {
            stream.write_all(head.as_bytes()).await?;
            stream.write_all(share(of)).await?;
            stream.shutdown().await?;
        }
        Delivery::Stall(of) => {
            stream.write_all(head.as_bytes()).await?;
            stream.write_all(share(of)).await?;
            stream.flush().await?;
            hold(stream).await;
        }
        Delivery::Reset(of) => {
            stream.write_all(head.as_bytes()).await?;
            stream.write_all(share(of)).await?;
            stream.flush().await?;
            stream.set_zero_linger()?;
        }
        Delivery::Silence => hold(stream).await,
        Delivery::Close => {}
        Delivery::Endless(bytes) => {
            stream.write_all(head.as_bytes()).await?;
            let block = vec![b' '; 64 << 10];
            let mut left = bytes;
            while left > 0 {
                let n = left.min(block.len() as u64);
                stream.write_all(&block[..n as usize]).await?;
                left -= n;
            }
            stream.shutdown().await?;
        }
    }
    Ok(false)
}

/// Waits until the other side gives up, or for a while.
async fn hold(stream: &mut TcpStream) {
    let mut one = [0; 1];
    let _ = tokio::time::timeout(HOLD, stream.read(&mut one)).await;
}

/// Who answers, and who is told how that went.
pub trait Play: Send + Sync + 'static {
    /// Answers; the number comes back in [`Play::sent`].
    fn play(&self, request: Request) -> impl Future<Output = (Reply, u64)> + Send;
    /// The answer of this number went out, whole or not.
    fn sent(&self, number: u64, whole: bool);
}

/// Serves connections until the task is ended. Connections are kept open, as real services do.
pub async fn serve(listener: TcpListener, player: Arc<impl Play>) {
    while let Ok((mut stream, _)) = listener.accept().await {
        let player = Arc::clone(&player);
        tokio::spawn(async move {
            let mut buffer = Vec::new();
            let _ = stream.set_nodelay(true);
            while let Ok(Some(request)) = read(&mut stream, &mut buffer).await {
                let (reply, number) = player.play(request).await;
                let sent = send(&mut stream, &reply).await;
                player.sent(number, matches!(sent, Ok(true)));
                if !matches!(sent, Ok(true)) {
                    break;
                }
            }
        });
    }
}
