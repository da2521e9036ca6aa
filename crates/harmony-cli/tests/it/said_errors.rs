//! What goes wrong on the first day, one by one: each message says what it is and what to do. Services are doubles on
//! loopback that give one answer to everything; their words are those that the services are known to use.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener};
use std::process::Output;

use crate::common::{drawn, program, said};

/// Gives every request this status and body, for as long as the test lives.
fn answering(status: u16, body: &'static str) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let Ok(mut stream) = stream else { return };
            match stream.read(&mut [0; 8192]) {
                Ok(0) | Err(_) => continue,
                Ok(_) => {}
            }
            let head = format!("HTTP/1.1 {status} Because\r\nContent-Type: application/json\r\nConnection: close\r\n");
            let _ = write!(stream, "{head}Content-Length: {}\r\n\r\n{body}", body.len());
        }
    });
    address
}

/// An address where nobody listens.
fn nobody() -> SocketAddr {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

const KEY: &str = "key-of-a-test-4711-opens-nothing";

/// A run with one player, all others being this program; keys are set or not.
fn run(section: &str, key: Option<&str>) -> Output {
    let folder = tempfile::tempdir().unwrap();
    let mut config = String::from("profile = \"paper\"\n");
    for role in ["vision_language", "image_editor", "mesh_generator", "detector"] {
        if !section.starts_with(&format!("[players.{role}]")) {
            config.extend(["[players.", role, "]\nplayer = \"offline\"\n"]);
        }
    }
    std::fs::write(folder.path().join("harmony.toml"), config + section).unwrap();
    drawn::empty_room(320, 240).save(folder.path().join("photo.png")).unwrap();
    let mut command = program();
    command.args(["reconstruct", "photo.png", "--out", "run", "--no-lit"]).current_dir(folder.path());
    command.env("HARMONY_MODELS", folder.path().join("no-models"));
    for (variable, ..) in harmony_cli::survey::KEYS {
        match key {
            Some(key) => command.env(variable, key),
            None => command.env_remove(variable),
        };
    }
    command.output().unwrap()
}

/// Player's section without its address; what answers; what the error and the hint have to say.
struct Case {
    section: &'static str,
    answer: Option<(u16, &'static str)>,
    key: Option<&'static str>,
    error: &'static str,
    hint: &'static str,
}

const OPENAI: &str = "[players.vision_language]\nplayer = \"openai\"\n";
const GEMINI: &str = "[players.vision_language]\nplayer = \"gemini\"\n";
const ANTHROPIC: &str = "[players.vision_language]\nplayer = \"anthropic\"\nmodel = \"some-model\"\n";
const OWN: &str = "[players.vision_language]\nplayer = \"compatible\"\nmodel = \"m\"\n";
const FAL: &str = "[players.mesh_generator]\nplayer = \"fal\"\n";
const REPLICATE: &str = "[players.mesh_generator]\nplayer = \"replicate\"\n";

#[test]
fn each_error_of_a_service_says_what_to_do() {
    let case = |section, status, body, error, hint| Case {
        section,
        answer: Some((status, body)),
        key: Some(KEY),
        error,
        hint,
    };
    let cases = [
        // A missing key, and one that is none.
        Case {
            section: OPENAI,
            answer: Some((200, "{}")),
            key: None,
            error: "OPENAI_API_KEY is not set",
            hint: "set OPENAI_API_KEY to your key",
        },
        Case { section: FAL, answer: Some((200, "{}")), key: None, error: "FAL_KEY is not set", hint: "set FAL_KEY" },
        Case {
            section: OPENAI,
            answer: Some((200, "{}")),
            key: Some("short"),
            error: "too short",
            hint: "the variable holds the key",
        },
        // A wrong one.
        case(
            OPENAI,
            401,
            r#"{"error":{"message":"Incorrect API key provided","code":"invalid_api_key"}}"#,
            "did not accept the key",
            "check OPENAI_API_KEY",
        ),
        case(
            GEMINI,
            400,
            r#"{"error":{"code":400,"message":"API key not valid. Please pass a valid API key.","status":"INVALID_ARGUMENT"}}"#,
            "did not accept the key",
            "check GEMINI_API_KEY",
        ),
        case(FAL, 401, r#"{"detail":"Invalid credentials"}"#, "did not accept the key", "check FAL_KEY"),
        // A spent account.
        case(
            OPENAI,
            429,
            r#"{"error":{"message":"You exceeded your current quota","code":"insufficient_quota"}}"#,
            "used up",
            "top up the account",
        ),
        case(
            ANTHROPIC,
            400,
            r#"{"type":"error","error":{"type":"invalid_request_error","message":"Your credit balance is too low to access the Anthropic API."}}"#,
            "the account is used up",
            "top up the account",
        ),
        case(
            REPLICATE,
            402,
            r#"{"title":"Insufficient credit","detail":"You have insufficient credit","status":402}"#,
            "the account is used up",
            "top up the account",
        ),
        case(
            FAL,
            403,
            r#"{"detail":"User is locked. Reason: Exhausted balance."}"#,
            "the account is used up",
            "top up",
        ),
        // A blocked region.
        case(
            OPENAI,
            403,
            r#"{"error":{"code":"unsupported_country_region_territory","message":"Country, region, or territory not supported"}}"#,
            "not offered where you are",
            "offered in your country",
        ),
        case(
            GEMINI,
            400,
            r#"{"error":{"code":400,"message":"User location is not supported for the API use.","status":"FAILED_PRECONDITION"}}"#,
            "not offered where you are",
            "another key does not help",
        ),
        // A model that is not there.
        case(
            OPENAI,
            404,
            r#"{"error":{"message":"The model does not exist","code":"model_not_found"}}"#,
            "no such model or address",
            "`model` in [players.vision_language]",
        ),
        // A service that is down, and a server that is not started.
        case(OPENAI, 503, "{}", "status 503", "or use --profile offline"),
        Case {
            section: OWN,
            answer: None,
            key: None,
            error: "no connection",
            hint: "start it (docs/players.md tells how)",
        },
    ];
    for case in cases {
        let address = case.answer.map_or_else(nobody, |(status, body)| answering(status, body));
        let output = run(&format!("{}address = \"http://{address}/v1\"\n", case.section), case.key);
        let said = said(&output);
        let line = |start: &str| said.lines().find_map(|line| line.strip_prefix(start)).unwrap_or_default().to_owned();
        let about = format!("{} {:?}: {said}", case.section, case.answer);
        assert_eq!(output.status.code(), Some(1), "{about}");
        assert!(line("error: ").contains(case.error), "no {:?}: {about}", case.error);
        assert!(line("hint: ").contains(case.hint), "no {:?}: {about}", case.hint);
        assert!(!said.contains(KEY), "a key is told: {about}");
    }
}

#[test]
#[cfg(all(feature = "nets", target_os = "linux"))]
fn too_little_memory_is_said_before_a_network_is_loaded() {
    let folder = tempfile::tempdir().unwrap();
    let weights = folder.path().join("vast.safetensors");
    // Takes no disk: nothing is in it.
    if std::fs::File::create(&weights).unwrap().set_len(1 << 40).is_err() {
        harmony_testing::skip("the file system has no sparse files of a tebibyte");
        return;
    }
    let section = "[players.geometry_estimator]\nplayer = \"vggt\"\ndevice = \"cpu\"\n";
    let output = run(&format!("{section}weights = {:?}\n", weights.display().to_string()), None);
    let said = said(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("too little memory: it takes 1025.1 GiB"), "{said}");
    let hint = said.lines().find_map(|line| line.strip_prefix("hint: ")).unwrap_or_default();
    assert!(hint.contains("close other programs") && hint.contains("[players.geometry_estimator]"), "{said}");
}

/// A double of NVIDIA's driver: a version and what it says when it is started.
#[cfg(all(feature = "cuda", target_os = "linux"))]
fn driver(folder: &std::path::Path, version: i32, init: i32, says: &str) -> bool {
    let source = format!(
        "int cuInit(unsigned flags) {{ return {init}; }}\n\
         int cuDriverGetVersion(int *version) {{ *version = {version}; return 0; }}\n\
         int cuDeviceGetCount(int *count) {{ *count = 0; return 0; }}\n\
         int cuGetErrorString(int error, const char **text) {{ *text = \"{says}\"; return 0; }}\n"
    );
    std::fs::write(folder.join("driver.c"), source).unwrap();
    let mut compiler = std::process::Command::new("cc");
    compiler.args(["-shared", "-fPIC", "-o"]).arg(folder.join("libcuda.so")).arg(folder.join("driver.c"));
    compiler.status().is_ok_and(|status| status.success())
}

#[test]
#[cfg(all(feature = "cuda", target_os = "linux"))]
fn a_driver_that_is_missing_or_old_is_told_with_what_to_do() {
    let doctor = |folder: &std::path::Path| {
        let mut command = program();
        command.args(["doctor", "--profile", "offline"]).env("HARMONY_MODELS", folder.join("no-models"));
        let output = command.env("LD_LIBRARY_PATH", folder).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", said(&output));
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        text.lines().find(|line| line.contains("no GPU: ")).unwrap_or_else(|| panic!("{text}")).to_owned()
    };
    let folder = tempfile::tempdir().unwrap();
    if !driver(folder.path(), 11_040, 0, "") {
        harmony_testing::skip("there is no C compiler");
        return;
    }
    let line = doctor(folder.path());
    assert!(line.contains("too old: it knows CUDA 11.4") && line.contains("install driver 580 or newer"), "{line}");
    for (error, says, what) in [
        (100, "no CUDA-capable device is detected", "--gpus all"),
        (803, "system has unsupported display driver / cuda driver combination", "started anew"),
    ] {
        driver(folder.path(), 13_000, error, says);
        let line = doctor(folder.path());
        assert!(line.contains(says) && line.contains(what), "{line}");
    }
    if std::path::Path::new("/proc/driver/nvidia/version").exists() {
        harmony_testing::skip("there is a driver on this machine: its absence is not tested");
        return;
    }
    let line = doctor(&folder.path().join("nothing"));
    assert!(line.contains("libcuda was not found") && line.contains("580"), "{line}");
}

/// A slim container has no root certificates: who asks nobody needs none, who does is told what to install.
#[test]
#[cfg(target_os = "linux")]
fn a_system_without_certificates_plays_what_asks_nobody() {
    let folder = tempfile::tempdir().unwrap();
    let none = folder.path().join("certificates.pem");
    std::fs::write(&none, "").unwrap();
    drawn::empty_room(320, 240).save(folder.path().join("photo.png")).unwrap();
    let harmony = |args: &[&str]| {
        let mut command = program();
        command.args(args).current_dir(folder.path()).env("HARMONY_MODELS", folder.path().join("no-models"));
        command.env("SSL_CERT_FILE", &none).env("SSL_CERT_DIR", folder.path()).env("GEMINI_API_KEY", KEY);
        command.env("FAL_KEY", KEY).output().unwrap()
    };
    let output = harmony(&["reconstruct", "photo.png", "--out", "run", "--no-lit", "--profile", "offline"]);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let output = harmony(&["reconstruct", "photo.png", "--out", "paid", "--no-lit", "--profile", "hosted"]);
    assert_ne!(output.status.code(), Some(0), "{}", said(&output));
    assert!(said(&output).contains("ca-certificates"), "{}", said(&output));
    let output = harmony(&["doctor", "--profile", "offline"]);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let told = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(told.contains("no service or server can be reached") && told.contains("ca-certificates"), "{told}");
}
