//! What there is on this machine to work with: keys in the environment, servers on their usual ports, GPUs, memory,
//! weights, Blender. `harmony doctor` shows it, `harmony setup` proposes from it.

use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Duration;

use harmony_models::Store;
use harmony_players::http::{ApiKey, Auth, Http, HttpLimits, HttpRequest, KeyError, Service, ServiceOptions};
use harmony_players::{casting_report, offline_cast};
use harmony_roles::Role;
use serde::Serialize;
use serde_json::Value;

use crate::models::bytes;
use crate::networks::status::{Weights, weights};

/// Longest answer of a server that is looked for, and the time that it has.
const ANSWER_BYTES: u64 = 1 << 20;
const PATIENCE: Duration = Duration::from_millis(1500);

/// How long the tool that knows of GPUs may take.
const GPU_PATIENCE: Duration = Duration::from_secs(5);

/// Variables that hold keys, whose they are, and what can be played with each.
pub const KEYS: [(&str, &str, &[Role]); 7] = [
    ("GEMINI_API_KEY", "Google Gemini", &[Role::VisionLanguage, Role::ImageEditor, Role::Detector]),
    ("OPENAI_API_KEY", "OpenAI", &[Role::VisionLanguage, Role::ImageEditor, Role::Detector]),
    ("ANTHROPIC_API_KEY", "Anthropic", &[Role::VisionLanguage, Role::Detector]),
    ("FAL_KEY", "fal.ai", &[Role::MeshGenerator]),
    ("REPLICATE_API_TOKEN", "Replicate", &[Role::MeshGenerator]),
    ("TRIPO_API_KEY", "Tripo", &[Role::MeshGenerator]),
    ("MESHY_API_KEY", "Meshy", &[Role::MeshGenerator]),
];

/// Where servers of one's own usually listen.
pub const USUAL: [&str; 6] = [
    "http://127.0.0.1:11434",
    "http://127.0.0.1:8000",
    "http://127.0.0.1:8080",
    "http://127.0.0.1:8081",
    "http://127.0.0.1:1234",
    "http://127.0.0.1:8188",
];

/// A key that is set. The key itself is not held.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FoundKey {
    /// Its variable.
    pub variable: &'static str,
    /// Whose it is.
    pub service: &'static str,
    /// Why it can be none, if it can't.
    pub problem: Option<String>,
}

/// A server that answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "names of programs")]
pub enum ServerKind {
    Ollama,
    Vllm,
    LlamaCpp,
    MistralRs,
    OtherChat,
    SdServer,
    Hunyuan2,
    Hunyuan21,
    Nim,
    ComfyUi,
}

impl ServerKind {
    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ollama => "Ollama",
            Self::Vllm => "vLLM",
            Self::LlamaCpp => "llama.cpp",
            Self::MistralRs => "mistral.rs",
            Self::OtherChat => "a server with chat completions",
            Self::SdServer => "sd-server",
            Self::Hunyuan2 => "Hunyuan3D-2",
            Self::Hunyuan21 => "Hunyuan3D-2.1",
            Self::Nim => "a container of NVIDIA",
            Self::ComfyUi => "ComfyUI",
        }
    }

    /// Whether it speaks chat completions.
    #[must_use]
    pub fn chats(self) -> bool {
        matches!(self, Self::Ollama | Self::Vllm | Self::LlamaCpp | Self::MistralRs | Self::OtherChat)
    }
}

/// Where it is.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FoundServer {
    /// Which.
    pub kind: ServerKind,
    /// Address as a player takes it.
    pub address: String,
    /// Its models, where it lists them.
    pub models: Vec<String>,
}

/// A GPU.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Gpu {
    /// Name.
    pub name: String,
    /// Memory, MiB.
    pub memory_mib: u64,
}

/// All of it.
#[derive(Debug, Serialize)]
pub struct Survey {
    /// Keys that are set.
    pub keys: Vec<FoundKey>,
    /// Servers that answer.
    pub servers: Vec<FoundServer>,
    /// Why nothing can be reached over a network at all, if so.
    pub no_network: Option<String>,
    /// NVIDIA GPUs.
    pub gpus: Vec<Gpu>,
    /// Processors.
    pub cores: usize,
    /// Memory, MiB; `None` = not known.
    pub memory_mib: Option<u64>,
    /// Whether this build has networks.
    pub networks: bool,
    /// Weights that are here.
    pub weights: Vec<Weights>,
    /// Folder of the weights.
    pub folder: PathBuf,
    /// Why there is no path tracer, if there is none.
    pub no_blender: Option<String>,
}

/// Looks around. `servers` are base addresses; each is asked a few questions that cost nothing.
///
/// # Errors
/// None in practice: a part of the looking panicked.
pub async fn survey(servers: &[String], store: &Store) -> anyhow::Result<Survey> {
    let http = Http::new(None, Duration::from_millis(800));
    let asked: Vec<_> = http
        .iter()
        .flat_map(|http| servers.iter().map(move |address| (http.clone(), address.clone())))
        .map(|(http, address)| tokio::spawn(async move { recognised(&http, &address).await }))
        .collect();
    let (gpus, no_blender) = tokio::task::spawn_blocking(|| (gpus(), no_blender())).await?;
    let mut found = Vec::new();
    for task in asked {
        found.extend(task.await?);
    }
    let memory = std::fs::read_to_string("/proc/meminfo").ok();
    Ok(Survey {
        keys: keys(),
        servers: found,
        no_network: http.err().map(|error| match error.hint() {
            Some(hint) => format!("{error}; {hint}"),
            None => error.to_string(),
        }),
        gpus,
        cores: std::thread::available_parallelism().map_or(1, std::num::NonZero::get),
        memory_mib: memory.as_deref().and_then(total_memory),
        networks: cfg!(feature = "nets"),
        weights: weights(store),
        folder: store.folder().to_path_buf(),
        no_blender,
    })
}

fn keys() -> Vec<FoundKey> {
    let found = |(variable, service, _): &(&'static str, &'static str, _)| {
        let problem = match ApiKey::from_env(variable) {
            Ok(_) => None,
            Err(KeyError::NotSet { .. }) => return None,
            Err(error) => Some(error.to_string()),
        };
        Some(FoundKey { variable, service, problem })
    };
    KEYS.iter().filter_map(found).collect()
}

/// `MemTotal` of Linux, MiB.
fn total_memory(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    Some(line.trim().trim_end_matches(" kB").trim().parse::<u64>().ok()? / 1024)
}

/// NVIDIA GPUs, as the driver's own tool lists them. No tool, no GPU.
fn gpus() -> Vec<Gpu> {
    let mut command = Command::new("nvidia-smi");
    command.args(["--query-gpu=name,memory.total", "--format=csv,noheader,nounits"]);
    let spawned = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
    let Ok(mut child) = spawned else { return Vec::new() };
    let until = std::time::Instant::now() + GPU_PATIENCE;
    while std::time::Instant::now() < until {
        match child.try_wait() {
            Ok(Some(_)) => {
                let text = child.wait_with_output().map(|output| output.stdout).unwrap_or_default();
                return listed_gpus(&String::from_utf8_lossy(&text));
            }
            Ok(None) => std::thread::sleep(Duration::from_millis(20)),
            Err(_) => break,
        }
    }
    let _ = child.kill();
    let _ = child.wait();
    Vec::new()
}

fn listed_gpus(text: &str) -> Vec<Gpu> {
    let gpu = |line: &str| {
        let (name, memory) = line.rsplit_once(',')?;
        Some(Gpu { name: name.trim().to_owned(), memory_mib: memory.trim().parse().ok()? })
    };
    text.lines().filter_map(gpu).collect()
}

fn no_blender() -> Option<String> {
    let report = casting_report(&offline_cast());
    let tracer = report.into_iter().find(|status| status.role == Role::LitRenderer)?;
    (!tracer.available).then(|| tracer.hint.unwrap_or(tracer.detail))
}

/// Who answers at an address, by what only they answer.
async fn recognised(http: &Http, address: &str) -> Option<FoundServer> {
    let options = ServiceOptions {
        player: "setup".to_owned(),
        address: address.to_owned(),
        auth: Auth::None,
        limits: HttpLimits { silence: PATIENCE, total: PATIENCE, answer_bytes: ANSWER_BYTES },
        remedy: String::new(),
    };
    let service = Service::new(http, options).ok()?;
    let ask = async |path: &str| {
        let answer = service.send(&HttpRequest::get(path)).await.ok()?;
        Some((answer.is_success(), serde_json::from_slice::<Value>(&answer.body).unwrap_or(Value::Null)))
    };
    let base = address.trim_end_matches('/');
    // Nobody there: no further question.
    let (listed, models) = ask("/v1/models").await?;
    if listed && models.get("data").is_some_and(Value::is_array) {
        let kind = match ask("/api/version").await {
            Some((true, version)) if version.get("version").is_some() => ServerKind::Ollama,
            _ => chat_server(&models),
        };
        return Some(FoundServer { kind, address: format!("{base}/v1"), models: ids(&models) });
    }
    let found = |kind| Some(FoundServer { kind, address: base.to_owned(), models: Vec::new() });
    let (ready, _) = ask("/v1/health/ready").await?;
    if ready {
        return found(ServerKind::Nim);
    }
    let (healthy, health) = ask("/health").await?;
    if healthy && health.get("worker_id").is_some() {
        return found(ServerKind::Hunyuan21);
    }
    let (known, state) = ask("/status/harmony-setup").await?;
    if known && state.get("status").is_some_and(Value::is_string) {
        return found(ServerKind::Hunyuan2);
    }
    let (shown, system) = ask("/system_stats").await?;
    if shown && system.get("devices").is_some() {
        return found(ServerKind::ComfyUi);
    }
    None
}

fn ids(models: &Value) -> Vec<String> {
    let data = models.get("data").and_then(Value::as_array).into_iter().flatten();
    data.filter_map(|model| model.get("id")?.as_str().map(str::to_owned)).take(20).collect()
}

/// Which server lists these models.
fn chat_server(models: &Value) -> ServerKind {
    if harmony_players::editor::wire::is_sd_server(models) {
        return ServerKind::SdServer;
    }
    let owner = models.pointer("/data/0/owned_by").and_then(Value::as_str).unwrap_or_default();
    match owner {
        "vllm" => ServerKind::Vllm,
        "llamacpp" => ServerKind::LlamaCpp,
        "library" => ServerKind::Ollama,
        _ if owner.starts_with("mistral") || owner == "local" => ServerKind::MistralRs,
        _ => ServerKind::OtherChat,
    }
}

impl Survey {
    /// A usable key.
    #[must_use]
    pub fn has_key(&self, variable: &str) -> bool {
        self.keys.iter().any(|key| key.variable == variable && key.problem.is_none())
    }

    /// The first server of one of these kinds.
    pub fn server(&self, is: impl Fn(ServerKind) -> bool) -> Option<&FoundServer> {
        self.servers.iter().find(|server| is(server.kind))
    }

    /// For people.
    pub fn lines(&self) -> Vec<String> {
        let mut lines = Vec::new();
        if self.keys.is_empty() {
            let names: Vec<&str> = KEYS.iter().map(|(variable, ..)| *variable).collect();
            lines.push(format!("no keys in the environment (looked for {})", names.join(", ")));
        }
        lines.extend(self.keys.iter().map(|key| match &key.problem {
            None => format!("key {:<20} {}", key.variable, key.service),
            Some(problem) => format!("key {:<20} not usable: {problem}", key.variable),
        }));
        lines.extend(self.servers.iter().map(|server| {
            let models =
                if server.models.is_empty() { String::new() } else { format!(": {}", server.models.join(", ")) };
            let unused = if server.kind == ServerKind::ComfyUi { " (no player speaks to it)" } else { "" };
            format!("server {} at {}{models}{unused}", server.kind.name(), server.address)
        }));
        if let Some(reason) = &self.no_network {
            lines.push(format!("no service or server can be reached: {reason}"));
        } else if self.servers.is_empty() {
            lines.push("no server of one's own answers at its usual address".to_owned());
        }
        lines.extend(self.gpus.iter().map(|gpu| format!("GPU {}, {} MiB", gpu.name, gpu.memory_mib)));
        let memory = self.memory_mib.map_or_else(String::new, |mib| format!(", {} memory", bytes(mib << 20)));
        let gpus = if self.gpus.is_empty() { ", no NVIDIA GPU" } else { "" };
        lines.push(format!("{} processors{memory}{gpus}", self.cores));
        lines.push(match &self.no_blender {
            None => "Blender Cycles is here: lit renders, and light fitted to the photo".to_owned(),
            Some(hint) => format!("no path tracer: {hint}"),
        });
        if !self.networks {
            lines.push("this build has no networks: geometry, masks and boxes come from rules and players".to_owned());
        }
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn gpus_and_memory_are_read_from_what_tools_print() {
        let gpus = listed_gpus("NVIDIA GeForce RTX 4090, 24564\nodd line\nTesla, T4, 15360\n");
        assert_eq!(gpus.len(), 2);
        assert_eq!((gpus[1].name.as_str(), gpus[1].memory_mib), ("Tesla, T4", 15360));
        assert_eq!(total_memory("MemTotal:       16384000 kB\nMemFree: 1 kB\n"), Some(16_000));
        assert_eq!(total_memory("nothing"), None);
    }

    #[test]
    fn servers_are_told_apart_by_their_lists_of_models() {
        let list = |id: &str, owner: &str| json!({"data": [{"id": id, "owned_by": owner}]});
        assert_eq!(chat_server(&list("sd-cpp-local", "local")), ServerKind::SdServer);
        assert_eq!(chat_server(&list("Qwen/Qwen3-VL", "vllm")), ServerKind::Vllm);
        assert_eq!(chat_server(&list("m", "llamacpp")), ServerKind::LlamaCpp);
        assert_eq!(chat_server(&list("m", "somebody")), ServerKind::OtherChat);
        assert_eq!(ids(&list("m", "x")), ["m"]);
    }
}
