//! Every command of `docs/first-day.md` is one that the program understands; those that are said to be tried do what they
//! say, in an empty folder with a photo, no keys and no servers.

use std::path::Path;
use std::process::Command;

/// Blocks of commands of the page: whether each is said to be tried, and its lines.
fn blocks(page: &str) -> Vec<(bool, Vec<String>)> {
    let mut blocks = Vec::new();
    let mut lines = page.lines();
    while let Some(line) = lines.next() {
        let Some(kind) = line.strip_prefix("```sh") else { continue };
        let inside = lines.by_ref().take_while(|line| !line.starts_with("```")).map(str::to_owned).collect();
        blocks.push((kind.trim() == "tried", inside));
    }
    blocks
}

/// Commands in the running text, in backticks.
fn inline(page: &str) -> Vec<String> {
    let odd = page.split('`').skip(1).step_by(2);
    odd.filter(|text| text.starts_with("harmony ") && !text.contains('\n')).map(str::to_owned).collect()
}

fn page() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/first-day.md");
    std::fs::read_to_string(path).unwrap()
}

fn words(command: &str) -> Vec<String> {
    command.split_whitespace().map(str::to_owned).collect()
}

#[test]
fn every_command_of_the_page_is_understood() {
    let page = page();
    // Without the blocks, so that a fence is not taken for code in the text.
    let text: String = page.split("```").step_by(2).collect();
    let blocks = blocks(&page);
    let commands: Vec<String> = blocks
        .into_iter()
        .flat_map(|(_, lines)| lines)
        .filter(|line| line.starts_with("harmony"))
        .chain(inline(&text))
        .collect();
    assert!(commands.len() > 20, "{}", commands.len());
    for command in commands {
        if let Err(error) = harmony_cli::understood(words(&command)) {
            panic!("{command}: {error}");
        }
    }
    assert!(harmony_cli::understood(words("harmony setup --meshs fal")).is_err(), "the test can fail");
}

#[test]
fn what_is_said_to_be_tried_does_what_it_says() {
    let folder = tempfile::tempdir().unwrap();
    let photo = image::RgbImage::from_fn(320, 240, |x, y| {
        if y > 170 { image::Rgb([120, 90, 70]) } else { image::Rgb([200, 200, (180 + x / 8) as u8]) }
    });
    photo.save(folder.path().join("room.jpg")).unwrap();
    let mut ran = 0;
    for (tried, lines) in blocks(&page()) {
        for line in lines.iter().filter(|line| tried && !line.is_empty()) {
            let words = words(line);
            assert_eq!(words[0], "harmony", "{line}");
            let mut command = Command::new(env!("CARGO_BIN_EXE_harmony"));
            command.args(&words[1..]).current_dir(folder.path()).env("NO_COLOR", "1").env_remove("RUST_LOG");
            command.env("HARMONY_MODELS", folder.path().join("no-models")).stdin(std::process::Stdio::null());
            for (variable, ..) in harmony_cli::survey::KEYS {
                command.env_remove(variable);
            }
            let output = command.output().unwrap();
            let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{line}: {said}");
            ran += 1;
        }
    }
    assert!(ran >= 7, "{ran}");
    assert!(folder.path().join("run/report.html").is_file() && folder.path().join("harmony.toml").is_file());
}

#[test]
fn the_page_shows_ten_faults_each_with_a_picture_that_is_there() {
    let page = page();
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
    let pictures = |text: &str| -> Vec<String> {
        text.split("![](").skip(1).filter_map(|rest| Some(rest.split_once(')')?.0.to_owned())).collect()
    };
    for picture in pictures(&page) {
        let size = image::image_dimensions(docs.join(&picture)).unwrap_or_else(|error| panic!("{picture}: {error}"));
        assert!(size.0 <= 800, "{picture}: pictures of this page are small");
    }
    let (_, wrong) = page.split_once("## When it looks wrong").unwrap();
    let rows = wrong.lines().filter(|line| line.starts_with("| ![]"));
    assert_eq!(rows.clone().count(), 10);
    assert!(rows.clone().all(|row| row.matches(" | ").count() == 3), "picture, fault, cause, what to do");
}
