//! With `--local-only` nothing leaves the machine: the system calls of the whole program are watched.
#![cfg(target_os = "linux")]

use std::collections::BTreeSet;
use std::net::{IpAddr, SocketAddr};
use std::path::Path;
use std::process::{Command, Output};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use harmony_bench::oracle::NoiseLevel;
use harmony_studio::profile::{Profile, config};
use harmony_studio::truth_oracle::TruthOracle;
use harmony_studio::{KEY, Studio, StudioOptions, rooms};

/// A name server is asked on this port; one on this machine would ask others.
const NAMES: u16 = 53;

/// Addresses that appear in the system calls that strace wrote down, IPv4 and IPv6.
///
/// `{sa_family=AF_INET, sin_port=htons(80), sin_addr=inet_addr("192.0.2.7")}` and
/// `{sa_family=AF_INET6, sin6_port=htons(80), ..., inet_pton(AF_INET6, "::1", &sin6_addr), ...}`.
fn addresses(trace: &str) -> BTreeSet<SocketAddr> {
    let between = |text: &str, before: &str, after: &str| -> Option<String> {
        let (_, rest) = text.split_once(before)?;
        Some(rest.split_once(after)?.0.to_owned())
    };
    let mut found = BTreeSet::new();
    for structure in trace.split("sa_family=AF_INET").skip(1) {
        let structure = structure.split_once('}').map_or(structure, |(own, _)| own);
        let port = between(structure, "port=htons(", ")").and_then(|port| port.parse().ok());
        let host =
            between(structure, "inet_addr(\"", "\"").or_else(|| between(structure, "inet_pton(AF_INET6, \"", "\""));
        let host: Option<IpAddr> = host.and_then(|host| host.parse().ok());
        // What is not understood must not pass for nothing.
        let (Some(port), Some(host)) = (port, host) else { panic!("strace wrote {structure:?}") };
        found.insert(SocketAddr::new(host, port));
    }
    found
}

/// Runs the program under strace; its addresses and what it said. Proxies lead to `proxy`.
async fn watched(folder: &Path, proxy: u16, args: &[&str]) -> (BTreeSet<SocketAddr>, Output, String) {
    let trace = folder.join("trace");
    let mut command = Command::new("strace");
    command.args(["-f", "-qq", "--seccomp-bpf", "-e", "trace=connect,sendto,sendmsg,sendmmsg", "-o"]).arg(&trace);
    command.arg(env!("CARGO_BIN_EXE_harmony-studio")).arg("harmony").args(args);
    command.env("NO_COLOR", "1").env_remove("RUST_LOG").env_remove("NO_PROXY").env_remove("no_proxy");
    command.env("HARMONY_MODELS", folder.join("no_models"));
    for name in ["OPENAI_API_KEY", "GEMINI_API_KEY"] {
        command.env(name, KEY);
    }
    for name in ["HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY", "http_proxy", "https_proxy", "all_proxy"] {
        command.env(name, format!("http://127.0.0.1:{proxy}"));
    }
    let output = tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout);
    (addresses(&std::fs::read_to_string(&trace).unwrap()), output, said)
}

/// Whether strace is there and may watch.
fn can_watch() -> bool {
    let tried = Command::new("strace").args(["-f", "-qq", "--seccomp-bpf", "-e", "trace=connect", "true"]).output();
    tried.is_ok_and(|output| output.status.success())
}

#[tokio::test(flavor = "multi_thread")]
async fn no_socket_leads_elsewhere() {
    if !can_watch() {
        return harmony_testing::skip("strace is not there, or may not watch");
    }
    let work = tempfile::tempdir().unwrap();
    let room = rooms::small(work.path()).unwrap();
    let photo = room.photo();
    let (points, masks) = (room.folder.join("depth.png"), room.folder.join("instances.png"));
    let k = room.camera.intrinsics;
    let intrinsics = format!("{},{},{},{}", k.fx, k.fy, k.cx, k.cy);
    let truth_oracle = Arc::new(TruthOracle::new(room, NoiseLevel::Clean.noise(), 1, false).unwrap());
    let studio = Studio::start(truth_oracle, StudioOptions::default(), 0).await.unwrap();
    // Who comes to the proxy.
    let proxy = tokio::net::TcpListener::bind(("127.0.0.1", 0)).await.unwrap();
    let port = proxy.local_addr().unwrap().port();
    let visits = Arc::new(AtomicUsize::new(0));
    let counted = Arc::clone(&visits);
    tokio::spawn(async move {
        while proxy.accept().await.is_ok() {
            counted.fetch_add(1, Ordering::SeqCst);
        }
    });
    let text = |path: &Path| path.to_str().unwrap().to_owned();
    let strangers = |seen: &BTreeSet<SocketAddr>| -> Vec<SocketAddr> {
        seen.iter().filter(|a| !a.ip().is_loopback()).copied().collect()
    };

    // A whole run with all services of the profile: each is on this machine.
    let file = work.path().join("local.toml");
    std::fs::write(&file, config(&studio, Profile::Local) + "\n[settings]\nworking_px = 256\n").unwrap();
    let (config, run) = (text(&file), text(&work.path().join("run")));
    let args = [
        "reconstruct",
        &text(&photo),
        "--out",
        &run,
        "--config",
        &config,
        "--points",
        &text(&points),
        "--intrinsics",
        &intrinsics,
        "--masks",
        &text(&masks),
        "--no-lit",
        "--local-only",
    ];
    let (seen, output, said) = watched(work.path(), port, &args).await;
    assert!(output.status.success(), "{said}");
    assert_eq!(strangers(&seen), []);
    assert!(seen.iter().all(|address| address.port() != NAMES && address.port() != port), "{seen:?}");
    assert!(!seen.is_empty() && studio.ledger.entries().len() > 5, "the studio was asked, and that was seen: {seen:?}");
    assert_eq!(visits.load(Ordering::SeqCst), 0, "no proxy is used");

    // The paper's profile as it is: its services are elsewhere, and are refused before a name is looked up.
    for command in ["doctor", "reconstruct"] {
        let run = text(&work.path().join("other"));
        let config = work.path().join("paper.toml");
        std::fs::write(&config, "profile = \"paper\"\n").unwrap();
        let (config, photo) = (text(&config), text(&photo));
        let mut args = vec![command, "--config", &config, "--local-only"];
        if command == "reconstruct" {
            args.extend([photo.as_str(), "--out", run.as_str(), "--no-lit"]);
        }
        let (seen, output, said) = watched(work.path(), port, &args).await;
        assert!(!output.status.success() && said.contains("local_only"), "{command}: {said}");
        assert_eq!(strangers(&seen), [], "{command}");
        assert!(seen.iter().all(|address| address.port() != NAMES && address.port() != port), "{command}: {seen:?}");
    }
    assert_eq!(visits.load(Ordering::SeqCst), 0, "no proxy is used");

    // The watch sees what leaves: without the promise the same services are asked, here through the proxy.
    let (seen, _, said) = watched(work.path(), port, &["doctor", "--profile", "paper"]).await;
    assert!(seen.iter().any(|address| address.port() == port), "{seen:?} {said}");
    assert!(visits.load(Ordering::SeqCst) > 0);
    assert_eq!(strangers(&seen), [], "the proxy is on this machine: the test itself asks nobody else");
}
