//! `harmony dataset faces` against a double of a detector on loopback.

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use harmony_dataset::add::init;
use harmony_dataset::config::Config;
use harmony_dataset::layout::{Split, sha256};
use harmony_dataset::sources::{self, Source, YesNo};
use image::{DynamicImage, ImageFormat, RgbImage};

use crate::common::{drawn, files, program, said};

/// A detector in the form of Hugging Face's task: what it answers depends on the width of the picture, as its PNG says.
struct Double {
    address: SocketAddr,
    asked: Arc<AtomicUsize>,
}

impl Double {
    fn start(answer: impl Fn(u32) -> (u16, String) + Send + 'static) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let asked = Arc::new(AtomicUsize::new(0));
        let count = Arc::clone(&asked);
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                let Some((mut stream, body)) = stream.ok().and_then(request) else { continue };
                // The check's picture and whatever else has no width of ours are free.
                let width = width_of(&body).unwrap_or(0);
                if [320, 330, 340, 350].contains(&width) {
                    count.fetch_add(1, Ordering::SeqCst);
                }
                let (status, text) = answer(width);
                let head =
                    format!("HTTP/1.1 {status} Because\r\nContent-Type: application/json\r\nConnection: close\r\n");
                let _ = write!(stream, "{head}Content-Length: {}\r\n\r\n{text}", text.len());
            }
        });
        Self { address, asked }
    }

    fn asked(&self) -> usize {
        self.asked.load(Ordering::SeqCst)
    }
}

/// Reads a request whole; its body.
fn request(mut stream: TcpStream) -> Option<(TcpStream, String)> {
    let mut bytes = Vec::new();
    let mut buffer = [0; 8192];
    loop {
        let n = stream.read(&mut buffer).ok().filter(|n| *n > 0)?;
        bytes.extend_from_slice(&buffer[..n]);
        let text = String::from_utf8_lossy(&bytes);
        let Some((head, body)) = text.split_once("\r\n\r\n") else { continue };
        let length = head
            .to_ascii_lowercase()
            .lines()
            .find_map(|line| line.strip_prefix("content-length:").and_then(|n| n.trim().parse::<usize>().ok()));
        if body.len() >= length.unwrap_or(0) {
            return Some((stream, body.to_owned()));
        }
    }
}

/// Width in the head of a PNG in base64: bytes 16 to 19 are in the letters 20 to 27.
fn width_of(body: &str) -> Option<u32> {
    const LETTERS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let value: serde_json::Value = serde_json::from_str(body).ok()?;
    let letters = value["inputs"].as_str()?.as_bytes().get(20..28)?;
    let mut bits = 0_u64;
    for letter in letters {
        bits = bits << 6 | LETTERS.iter().position(|l| l == letter)? as u64;
    }
    // Letter 20 begins byte 15.
    Some((bits >> 8) as u32)
}

/// A data set of four photos, 320 to 350 pixels wide; the last one is not published. Only what this command reads is there.
fn data_set(root: &Path) {
    init(root, &Config::new("test-rooms", "CC-BY-NC-4.0")).unwrap();
    let row = |name: &str, width: u32, redistributable, blur: &str| {
        let image: RgbImage = drawn::empty_room(width, 240);
        let photo = drawn::encoded(&DynamicImage::ImageRgb8(image), ImageFormat::Png);
        let path = root.join("medium").join(name).join("photo.png");
        harmony_io::write_atomic(&path, &photo).unwrap();
        Source {
            split: Split::Medium,
            name: name.into(),
            source: "own".into(),
            source_id: String::new(),
            source_url: String::new(),
            author: "Ada".into(),
            licence: "CC0-1.0".into(),
            licence_url: String::new(),
            retrieved_at: "2026-01-02".into(),
            width,
            height: 240,
            sha256: sha256(&photo),
            redistributable,
            blur: blur.into(),
            faces: String::new(),
            note: String::new(),
        }
    };
    let rows = [
        row("bedroom_01", 320, YesNo::Yes, "1 1 20 20"),
        row("bedroom_02", 330, YesNo::Yes, ""),
        row("bedroom_03", 340, YesNo::Yes, ""),
        row("bedroom_04", 350, YesNo::No, ""),
    ];
    sources::save(root, &rows).unwrap();
}

struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new(config: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        data_set(&folder.path().join("set"));
        std::fs::write(folder.path().join("harmony.toml"), config).unwrap();
        Self { folder }
    }

    fn root(&self) -> PathBuf {
        self.folder.path().join("set")
    }

    fn run(&self, args: &[&str]) -> Output {
        let mut command = program();
        command.args(["dataset"]).args(args).current_dir(self.folder.path());
        command.env("HARMONY_MODELS", self.folder.path().join("no-models")).output().unwrap()
    }

    fn rows(&self) -> Vec<Source> {
        sources::load(&self.root()).unwrap()
    }
}

fn out(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn config(address: SocketAddr) -> String {
    format!(
        "profile = \"paper\"\n[limits.retry]\nretries = 0\n[prices.models.\"grounding-dino-base\"]\ncall = 0.5\n\
         [players.detector]\nplayer = \"grounding_dino\"\naddress = \"http://{address}/\"\nthreshold = 0.05\n"
    )
}

/// One face for sure and one perhaps in the first photo, none in the second; the third is refused as long as `broken`.
fn answers(broken: Arc<AtomicUsize>) -> impl Fn(u32) -> (u16, String) {
    let found = |score: f64, x: u32| {
        format!(
            "{{\"score\": {score}, \"label\": \"human face\", \
             \"box\": {{\"xmin\": {x}, \"ymin\": 100, \"xmax\": {}, \"ymax\": 140}}}}",
            x + 40
        )
    };
    move |width| match width {
        320 => (200, format!("[{}, {}]", found(0.9, 100), found(0.1, 200))),
        340 if broken.load(Ordering::SeqCst) > 0 => (500, "{\"error\": \"the model ran out of memory\"}".to_owned()),
        _ => (200, "[]".to_owned()),
    }
}

#[test]
fn faces_are_found_told_and_written_and_nobody_is_asked_twice() {
    let broken = Arc::new(AtomicUsize::new(1));
    let double = Double::start(answers(Arc::clone(&broken)));
    let place = Place::new(&config(double.address));
    let first = place.run(&["faces", "set"]);
    let (told, warned) = (out(&first), said(&first));
    assert_eq!(first.status.code(), Some(3), "one of three has no answer: {told}{warned}");
    assert_eq!(double.asked(), 3, "{told}{warned}");
    assert!(told.contains("is asked about 3 of 4 photos, 1 not published; about 1.50 US$"), "{told}");
    assert!(told.contains("medium/bedroom_01: 94 94 146 146, score 0.90\n"), "{told}");
    assert!(told.contains("medium/bedroom_01: 194 94 246 146, score 0.10, below 0.25: not blurred"), "{told}");
    assert!(told.contains("2 photos looked at, 2 faces, 1 regions added, 1 faces not blurred"), "{told}");
    assert!(warned.contains("medium/bedroom_03: not looked at") && warned.contains("1 photos could not"), "{warned}");
    assert!(warned.contains("detectors miss faces"), "{warned}");
    let rows = place.rows();
    let who = "grounding_dino grounding-dino-base, threshold 0.05";
    assert_eq!((rows[0].blur.as_str(), rows[0].faces.as_str()), ("1 1 20 20; 94 94 146 146", who));
    assert_eq!((rows[1].blur.as_str(), rows[1].faces.as_str()), ("", who), "nobody there, and that is known");
    assert!(!rows[2].is_looked_at() && !rows[3].is_looked_at());

    // The check tells who was never looked at, and only of what is published.
    let check = out(&place.run(&["check", "set"]));
    let missed: Vec<&str> = check.lines().filter(|line| line.contains("looked for faces")).collect();
    assert!(missed.len() == 1 && missed[0].starts_with("warning") && missed[0].contains("bedroom_03"), "{check}");

    // Again: what was answered is not asked again, and a lower bound takes what was found before.
    broken.store(0, Ordering::SeqCst);
    let second = place.run(&["faces", "set", "--min-score", "0.1"]);
    assert!(second.status.success(), "{}{}", out(&second), said(&second));
    assert!(out(&second).contains("is asked about 1 of 4 photos, has answered about 2 already"), "{}", out(&second));
    assert_eq!(double.asked(), 4);
    let rows = place.rows();
    assert_eq!(rows[0].blur, "1 1 20 20; 94 94 146 146; 194 94 246 146");
    assert_eq!((rows[2].blur.as_str(), rows[2].faces.as_str()), ("", who));

    // Nothing is left to do; no photo was copied into the records.
    let third = place.run(&["faces", "set", "--only-new"]);
    assert!(third.status.success() && out(&third).contains("there is no photo to look at"), "{}", out(&third));
    assert_eq!((double.asked(), place.rows()), (4, rows));
    let kept = files(&place.root().join("faces"));
    assert!(kept.keys().all(|path| path.extension().is_none_or(|e| e != "png")), "{:?}", kept.keys());
}

#[test]
fn a_budget_stops_before_it_is_spent_and_the_rest_goes_on_later() {
    let double = Double::start(answers(Arc::default()));
    let place = Place::new(&config(double.address));
    let stopped = place.run(&["faces", "set", "--max-usd", "0.6"]);
    assert_eq!(stopped.status.code(), Some(4), "{}{}", out(&stopped), said(&stopped));
    assert!(said(&stopped).contains("2 photos were not asked about: budget reached"), "{}", said(&stopped));
    assert_eq!(double.asked(), 1);
    assert_eq!(place.rows().iter().filter(|row| !row.faces.is_empty()).count(), 1, "what was paid is written");
    let rest = place.run(&["faces", "set", "--max-usd", "5"]);
    assert!(rest.status.success(), "{}{}", out(&rest), said(&rest));
    assert_eq!(double.asked(), 3);
}

#[test]
fn who_finds_no_faces_is_refused_with_what_to_do_and_nothing_is_changed() {
    let nobody = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let place = Place::new(&config(nobody));
    let before = files(&place.root());
    let refused = |args: &[&str], code: i32, what: &str| {
        let output = place.run(args);
        let said = said(&output);
        assert_eq!(output.status.code(), Some(code), "{args:?}: {said}");
        assert!(said.contains(what) && !said.contains("panicked"), "{args:?}: {said}");
        assert!(code != 1 || said.contains("hint: "), "{args:?}: {said}");
        assert!(files(&place.root()) == before, "{args:?}: something was changed");
    };
    for profile in ["offline", "files"] {
        refused(&["faces", "set", "--profile", profile], 1, "finds faces");
    }
    // A server that is not there; a data set that is none; what no command line may say.
    refused(&["faces", "set"], 1, "detector: ");
    refused(&["faces", "nowhere"], 1, "holds no data set");
    refused(&["faces", "set", "--profile", "best"], 2, "best");
    refused(&["faces", "set", "--min-score", "2"], 2, "from 0 to 1");
    // A language model that does not see is asked for boxes.
    let blind = "profile = \"local\"\n[players.vision_language]\nplayer = \"offline\"\n";
    std::fs::write(place.folder.path().join("blind.toml"), blind).unwrap();
    refused(&["faces", "set", "--config", "blind.toml"], 1, "finds faces");
}
