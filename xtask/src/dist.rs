//! What is given to users: the stripped program, completions and man pages made from its own command line, licences of
//! all that is in it, a list of its parts (CycloneDX), checksums of everything.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};
use serde::Deserialize;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

/// Shells for which completions are made, with the file name that each looks for.
const SHELLS: [(&str, &str); 4] =
    [("bash", "harmony.bash"), ("zsh", "_harmony"), ("fish", "harmony.fish"), ("powershell", "_harmony.ps1")];

/// Beginnings of the names of files that hold a licence.
const LICENCE_FILES: [&str; 5] = ["license", "licence", "copying", "notice", "unlicense"];

/// What is asked for.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Features of the program, such as `nets` or `cuda`.
    #[arg(long, default_value = "")]
    features: String,
    /// Target triple; left out = this machine's. It has to be installed (`rustup target add`).
    #[arg(long)]
    target: Option<String>,
    /// Build with cargo-zigbuild, which brings a C++ compiler for any target; then the oldest glibc may stand behind the
    /// target, as in x86_64-unknown-linux-gnu.2.28.
    #[arg(long)]
    zig: bool,
    /// A program that runs here and writes completions and man pages, when the packaged one does not.
    #[arg(long)]
    describe_with: Option<PathBuf>,
    /// Package this program instead of building one.
    #[arg(long)]
    binary: Option<PathBuf>,
    /// Name of the package, as x86_64-unknown-linux-musl: its folder is target/packages/harmony-VERSION-NAME then, and
    /// it is packed beside it, as .tar.gz.
    #[arg(long, conflicts_with = "out")]
    package: Option<String>,
    /// Folder that is written; it must not be there.
    // Not below target/dist, where cargo puts what it builds with the profile `dist`.
    #[arg(long, default_value = "target/packages/harmony")]
    out: PathBuf,
}

impl Options {
    /// The folder that is written.
    fn folder(&self) -> PathBuf {
        let packed = |name: &String| Path::new("target/packages").join(package(name));
        self.package.as_ref().map_or_else(|| self.out.clone(), packed)
    }
}

/// Folder of a package in its archive, which is called the same.
fn package(name: &str) -> String {
    format!("harmony-{}-{name}", env!("CARGO_PKG_VERSION"))
}

/// File name of the program.
fn program_name(binary: &Path) -> &'static str {
    if binary.extension().is_some_and(|ending| ending == "exe") { "harmony.exe" } else { "harmony" }
}

/// Builds and packages.
///
/// # Errors
/// A build or a tool that fails, a folder that is there already.
pub fn run(root: &Path, options: &Options) -> Result<()> {
    let out = root.join(options.folder());
    if out.exists() {
        bail!("{} is there already; remove it or name another with --out", out.display());
    }
    let binary = match &options.binary {
        Some(binary) => binary.clone(),
        None => build(root, options)?,
    };
    fs::create_dir_all(&out).with_context(|| format!("making {}", out.display()))?;
    let name = program_name(&binary);
    let program = out.join(name);
    fs::copy(&binary, &program).with_context(|| format!("copying {}", binary.display()))?;
    describe(options.describe_with.as_deref().unwrap_or(&program), &out)?;
    let parts = parts(root, options)?;
    fs::write(out.join("harmony.cdx.json"), serde_json::to_string_pretty(&bill_of_materials(&parts))?)?;
    fs::write(out.join("THIRD_PARTY_LICENCES.txt"), licences(&parts)?)?;
    for file in ["README.md", "LICENSE-MIT", "LICENSE-APACHE"] {
        fs::copy(root.join(file), out.join(file)).with_context(|| format!("copying {file}"))?;
    }
    let sums = checksums(&out)?;
    fs::write(out.join("SHA256SUMS"), sums)?;
    let size = fs::metadata(&program)?.len();
    println!("{}: {:.1} MB, {} parts, in {}", name, size as f64 / 1e6, parts.len(), out.display());
    if options.package.is_some() {
        println!("{}", pack(&out)?.display());
    }
    Ok(())
}

/// A folder as an archive beside it.
fn pack(folder: &Path) -> Result<PathBuf> {
    let (Some(parent), Some(name)) = (folder.parent(), folder.file_name()) else { bail!("no folder to be packed") };
    let archive = folder.with_added_extension("tar.gz");
    stdout(Command::new("tar").arg("-C").arg(parent).arg("-czf").arg(&archive).arg(name))?;
    Ok(archive)
}

/// Builds the stripped program with its commit in it.
fn build(root: &Path, options: &Options) -> Result<PathBuf> {
    let commit = stdout(Command::new("git").args(["rev-parse", "--short=12", "HEAD"]).current_dir(root))?;
    let changed = stdout(Command::new("git").args(["status", "--porcelain"]).current_dir(root))?;
    let commit = if changed.is_empty() { commit } else { format!("{commit} with changes") };
    let mut cargo = Command::new(env!("CARGO"));
    let build = if options.zig { "zigbuild" } else { "build" };
    cargo.args([build, "--profile", "dist", "-p", "harmony-cli", "--message-format", "json-render-diagnostics"]);
    if !options.features.is_empty() {
        cargo.args(["--features", &options.features]);
    }
    if let Some(target) = &options.target {
        cargo.args(["--target", target]);
    }
    let text = stdout(cargo.current_dir(root).env("HARMONY_COMMIT", commit))?;
    executable(&text).context("the build names no program")
}

/// A target without the version of glibc that may stand behind it.
fn triple(target: &str) -> &str {
    target.split_once('.').map_or(target, |(triple, _)| triple)
}

/// The program that cargo's messages name.
fn executable(messages: &str) -> Option<PathBuf> {
    let of = |line: &str| {
        let message: Value = serde_json::from_str(line).ok()?;
        let ours = message.pointer("/target/name")?.as_str()? == "harmony";
        ours.then(|| message.get("executable")?.as_str().map(PathBuf::from))?
    };
    messages.lines().rev().find_map(of)
}

/// What a tool prints; its failure is an error.
fn stdout(command: &mut Command) -> Result<String> {
    let output =
        command.stderr(std::process::Stdio::inherit()).output().with_context(|| format!("starting {command:?}"))?;
    if !output.status.success() {
        bail!("{command:?} failed: {}", output.status);
    }
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Completions and man pages, made by the program itself.
fn describe(program: &Path, out: &Path) -> Result<()> {
    let completions = out.join("completions");
    fs::create_dir(&completions)?;
    for (shell, file) in SHELLS {
        let text = stdout(Command::new(program).args(["completions", shell]))?;
        fs::write(completions.join(file), text + "\n")?;
    }
    stdout(Command::new(program).arg("man").arg("--out").arg(out.join("man")))?;
    Ok(())
}

/// One crate of the program.
#[derive(Debug, Clone, Deserialize)]
pub struct Part {
    name: String,
    version: String,
    id: String,
    license: Option<String>,
    license_file: Option<PathBuf>,
    source: Option<String>,
    repository: Option<String>,
    manifest_path: PathBuf,
}

#[derive(Deserialize)]
struct Metadata {
    packages: Vec<Part>,
    resolve: Resolve,
}

#[derive(Deserialize)]
struct Resolve {
    nodes: Vec<Node>,
}

#[derive(Deserialize)]
struct Node {
    id: String,
    deps: Vec<Dep>,
}

#[derive(Deserialize)]
struct Dep {
    pkg: String,
    dep_kinds: Vec<Kind>,
}

#[derive(Deserialize)]
struct Kind {
    kind: Option<String>,
}

/// All crates of others that are compiled into the program, in order: what is needed to build or test it only is not.
fn parts(root: &Path, options: &Options) -> Result<Vec<Part>> {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["metadata", "--format-version", "1", "--locked"]);
    let manifest = root.join("crates/harmony-cli/Cargo.toml");
    cargo.arg("--manifest-path").arg(manifest);
    let host = || {
        let text = stdout(Command::new("rustc").arg("-vV"))?;
        let host = text.lines().find_map(|line| line.strip_prefix("host: ")).map(str::to_owned);
        host.context("rustc names no host")
    };
    let target = options.target.clone().map_or_else(host, Ok)?;
    cargo.args(["--filter-platform", triple(&target)]);
    if !options.features.is_empty() {
        cargo.args(["--features", &options.features]);
    }
    let metadata: Metadata =
        serde_json::from_str(&stdout(cargo.current_dir(root))?).context("reading cargo metadata")?;
    linked(&metadata)
}

/// Of all crates, those that the program is linked from.
fn linked(metadata: &Metadata) -> Result<Vec<Part>> {
    let nodes: BTreeMap<&str, &Node> = metadata.resolve.nodes.iter().map(|node| (node.id.as_str(), node)).collect();
    let root = metadata.packages.iter().find(|part| part.name == "harmony-cli").context("there is no harmony-cli")?;
    let mut seen = BTreeSet::from([root.id.as_str()]);
    let mut todo = vec![root.id.as_str()];
    while let Some(id) = todo.pop() {
        let normal = |dep: &&Dep| dep.dep_kinds.iter().any(|kind| kind.kind.is_none());
        for dep in nodes.get(id).into_iter().flat_map(|node| node.deps.iter()).filter(normal) {
            if seen.insert(&dep.pkg) {
                todo.push(&dep.pkg);
            }
        }
    }
    let mut parts: Vec<Part> = metadata
        .packages
        .iter()
        .filter(|part| part.source.is_some() && seen.contains(part.id.as_str()))
        .cloned()
        .collect();
    parts.sort_by(|a, b| (&a.name, &a.version).cmp(&(&b.name, &b.version)));
    Ok(parts)
}

/// The list of parts, CycloneDX 1.5.
pub fn bill_of_materials(parts: &[Part]) -> Value {
    let component = |part: &Part| {
        let purl = format!("pkg:cargo/{}@{}", part.name, part.version);
        let mut component = json!({
            "type": "library", "bom-ref": purl, "name": part.name, "version": part.version, "purl": purl,
        });
        if let Some(expression) = &part.license {
            // Older crates write `/` where SPDX has OR.
            component["licenses"] = json!([{"expression": expression.replace('/', " OR ")}]);
        }
        if let Some(repository) = &part.repository {
            component["externalReferences"] = json!([{"type": "vcs", "url": repository}]);
        }
        component
    };
    json!({
        "bomFormat": "CycloneDX", "specVersion": "1.5", "version": 1,
        "metadata": {"component": {"type": "application", "name": "harmony", "version": env!("CARGO_PKG_VERSION")}},
        "components": parts.iter().map(component).collect::<Vec<_>>(),
    })
}

/// The texts of all licences, each once, with the crates that it is of.
fn licences(parts: &[Part]) -> Result<String> {
    let mut texts: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut without = Vec::new();
    for part in parts {
        let name = format!("{} {}", part.name, part.version);
        let found = licence_texts(part)?;
        if found.is_empty() {
            without.push(format!("{name}: {}", part.license.as_deref().unwrap_or("no licence is named")));
        }
        for text in found {
            texts.entry(text).or_default().push(name.clone());
        }
    }
    let mut all = String::from("Licences of the crates that harmony is made of, each text once.\n");
    if !without.is_empty() {
        let _ = writeln!(all, "\nNamed by these crates, whose packages hold no text:\n  {}", without.join("\n  "));
    }
    let mut ordered: Vec<(&String, &Vec<String>)> = texts.iter().collect();
    ordered.sort_by(|a, b| a.1.cmp(b.1));
    for (text, names) in ordered {
        let _ = writeln!(all, "\n{}\n{}\n\n{}", "=".repeat(100), names.join(", "), text.trim());
    }
    Ok(all)
}

/// The licence texts beside a crate's manifest.
fn licence_texts(part: &Part) -> Result<Vec<String>> {
    let folder = part.manifest_path.parent().unwrap_or(Path::new("."));
    let mut files: Vec<PathBuf> = part.license_file.iter().map(|file| folder.join(file)).collect();
    for entry in fs::read_dir(folder).with_context(|| format!("listing {}", folder.display()))? {
        let path = entry?.path();
        let name = path.file_name().map(|name| name.to_string_lossy().to_lowercase()).unwrap_or_default();
        if path.is_file() && LICENCE_FILES.iter().any(|start| name.starts_with(start)) {
            files.push(path);
        }
    }
    files.sort();
    files.dedup();
    let text = |path: &PathBuf| fs::read_to_string(path).ok().map(|text| text.replace("\r\n", "\n"));
    Ok(files.iter().filter_map(text).filter(|text| !text.trim().is_empty()).collect())
}

/// `sha256sum`'s form, of all files below a folder.
pub fn checksums(folder: &Path) -> Result<String> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(at) = folders.pop() {
        for entry in fs::read_dir(&at)? {
            let path = entry?.path();
            if path.is_dir() { folders.push(path) } else { files.push(path) }
        }
    }
    files.sort();
    let mut text = String::new();
    for path in files {
        let sum = Sha256::digest(fs::read(&path)?);
        let name = path.strip_prefix(folder)?.to_string_lossy().replace('\\', "/");
        let _ = writeln!(text, "{sum:x}  {name}");
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(name: &str, folder: &Path) -> Part {
        Part {
            name: name.into(),
            version: "1.0.0".into(),
            id: name.into(),
            license: Some("MIT/Apache-2.0".into()),
            license_file: None,
            source: Some("registry".into()),
            repository: None,
            manifest_path: folder.join("Cargo.toml"),
        }
    }

    #[test]
    fn what_is_linked_is_listed_and_what_only_builds_or_tests_is_not() {
        let package = |name: &str, source: Option<&str>| {
            json!({"name": name, "version": "1.0.0", "id": name, "license": "MIT", "license_file": null,
                   "source": source, "repository": null, "manifest_path": "/x/Cargo.toml"})
        };
        let dep = |name: &str, kind: Option<&str>| json!({"pkg": name, "dep_kinds": [{"kind": kind}]});
        let metadata = json!({
        "packages": [package("harmony-cli", None), package("harmony-io", None), package("png", Some("r")),
                     package("cc", Some("r")), package("proptest", Some("r")), package("apart", Some("r"))],
        "resolve": {"nodes": [
            {"id": "harmony-cli", "deps": [dep("harmony-io", None), dep("proptest", Some("dev"))]},
            {"id": "harmony-io", "deps": [dep("png", None), dep("cc", Some("build"))]},
            {"id": "png", "deps": []}, {"id": "cc", "deps": []}, {"id": "proptest", "deps": []},
        ]}});
        let parts = linked(&serde_json::from_value(metadata).unwrap()).unwrap();
        assert_eq!(parts.iter().map(|part| part.name.as_str()).collect::<Vec<_>>(), ["png"]);
    }

    #[test]
    fn licences_are_gathered_once_and_missing_ones_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let make = |name: &str, text: Option<&str>| {
            let at = folder.path().join(name);
            fs::create_dir(&at).unwrap();
            if let Some(text) = text {
                fs::write(at.join("LICENSE-MIT"), text).unwrap();
            }
            part(name, &at)
        };
        let parts = [make("a", Some("Be kind.\r\n")), make("b", Some("Be kind.\n")), make("c", None)];
        let text = licences(&parts).unwrap();
        assert_eq!(text.matches("Be kind.").count(), 1);
        assert!(text.contains("a 1.0.0, b 1.0.0") && text.contains("c 1.0.0: MIT/Apache-2.0"), "{text}");
        let bill = bill_of_materials(&parts);
        assert_eq!(bill["components"][0]["purl"], "pkg:cargo/a@1.0.0");
        assert_eq!(bill["components"][0]["licenses"][0]["expression"], "MIT OR Apache-2.0");
    }

    #[test]
    fn checksums_are_those_of_sha256sum_and_the_program_is_found_in_cargos_messages() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("man")).unwrap();
        fs::write(folder.path().join("man/a"), "abc").unwrap();
        let sums = checksums(folder.path()).unwrap();
        // FIPS 180-2, the example of one block.
        assert_eq!(sums, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad  man/a\n");
        let messages = "not json\n{\"reason\":\"compiler-artifact\",\"target\":{\"name\":\"harmony\"},\"executable\":\"/t/harmony\"}\n\
                        {\"target\":{\"name\":\"other\"},\"executable\":\"/t/other\"}";
        assert_eq!(executable(messages), Some(PathBuf::from("/t/harmony")));
        assert_eq!(triple("x86_64-unknown-linux-gnu.2.28"), triple("x86_64-unknown-linux-gnu"));
    }

    #[derive(clap::Parser)]
    struct Given {
        #[command(flatten)]
        options: Options,
    }

    fn read(file: &str) -> String {
        fs::read_to_string(crate::root().join(file)).unwrap()
    }

    /// What is asked for in each line of a file that packages.
    fn asked(text: &str) -> Vec<Options> {
        let lines = text.lines().filter_map(|line| line.split_once("cargo xtask dist").map(|(_, words)| words));
        let words = lines.filter(|words| words.trim_start().starts_with("--")).map(|words| {
            let words = words.split(" #").next().unwrap_or_default().split_whitespace();
            ["dist".to_owned()].into_iter().chain(words.map(|word| word.trim_matches(['"', '\'']).to_owned()))
        });
        words.map(|words| <Given as clap::Parser>::try_parse_from(words).unwrap().options).collect()
    }

    /// The release workflow's packages: its command with each row of its matrix.
    fn released() -> Vec<Options> {
        let workflow = read(".github/workflows/release.yml");
        let rows = workflow.lines().filter_map(|line| line.trim().strip_prefix("- { ")?.strip_suffix(" }"));
        let mut all = Vec::new();
        for row in rows.filter(|row| row.starts_with("target: ")) {
            let row: BTreeMap<&str, &str> = row.split(", ").filter_map(|field| field.split_once(": ")).collect();
            let mut text =
                workflow.replace("${{ matrix.zig && '--zig' || '' }}", if row["zig"] == "true" { "--zig" } else { "" });
            for (field, value) in &row {
                text = text.replace(&format!("${{{{ matrix.{field} }}}}"), value);
            }
            let mut options = asked(&text);
            assert_eq!(options.len(), 1, "one command makes the package");
            all.append(&mut options);
        }
        all
    }

    fn manifest() -> toml::Table {
        toml::from_str(&read("crates/harmony-cli/Cargo.toml")).unwrap()
    }

    #[test]
    fn what_binstall_looks_for_is_what_a_release_has() {
        let manifest = manifest();
        let about = &manifest["package"]["metadata"]["binstall"];
        let released = released();
        assert!(released.len() >= 5);
        let made: BTreeSet<String> =
            released.iter().map(|options| package(options.package.as_ref().unwrap())).collect();
        assert_eq!(made.len(), released.len(), "each has a name of its own");
        let triples = released.iter().map(|options| triple(options.target.as_ref().unwrap()).to_owned());
        let overrides = about.get("overrides").and_then(toml::Value::as_table);
        let overridden = overrides.into_iter().flat_map(|table| table.keys().cloned());
        let mut found = BTreeSet::new();
        for target in triples.chain(overridden).collect::<BTreeSet<_>>() {
            let own = overrides.and_then(|table| table.get(&target));
            let program = if target.contains("windows") { "harmony.exe" } else { "harmony" };
            let said = |key: &str| {
                let text = own.and_then(|own| own.get(key)).unwrap_or(&about[key]).as_str().unwrap();
                text.replace("{ version }", env!("CARGO_PKG_VERSION"))
                    .replace("{ target }", &target)
                    .replace("{ archive-suffix }", ".tar.gz")
                    .replace("{ bin }{ binary-ext }", program)
            };
            let (address, inside) = (said("pkg-url"), said("bin-dir"));
            let tag = format!("{{ repo }}/releases/download/v{}/", env!("CARGO_PKG_VERSION"));
            let folder = address.strip_prefix(&tag).and_then(|file| file.strip_suffix(".tar.gz")).unwrap().to_owned();
            assert!(made.contains(&folder), "{target}: no release has {folder}: {made:?}");
            assert_eq!(inside, format!("{folder}/{}", program_name(Path::new(program))), "{target}");
            found.insert(folder);
        }
        // GPUs are for who asks for them.
        assert!(
            made.iter().filter(|folder| !folder.ends_with("-cuda")).all(|folder| found.contains(folder)),
            "{found:?}"
        );
    }

    #[test]
    fn release_containers_and_page_ask_for_what_there_is_and_take_it_from_where_it_is() {
        let manifest = manifest();
        let features = manifest["features"].as_table().unwrap();
        for file in ["Dockerfile", "Dockerfile.nvidia"] {
            let text = read(file).replace("$FEATURES", "nets");
            let options = asked(&text);
            assert_eq!(options.len(), 1, "{file}");
            let from = format!("COPY --from=build /harmony/{} ", options[0].folder().display());
            assert!(text.contains(&from), "{file}: {from}");
        }
        let page = asked(&read("docs/install.md"));
        assert!(page.len() >= 2);
        let containers =
            ["Dockerfile", "Dockerfile.nvidia"].map(|file| asked(&read(file).replace("$FEATURES", "nets")));
        for options in released().into_iter().chain(page).chain(containers.into_iter().flatten()) {
            assert!(!options.folder().starts_with("target/dist"), "there is cargo's own folder");
            let wanted = options.features.split(',').filter(|feature| !feature.is_empty());
            for feature in wanted {
                assert!(features.contains_key(feature), "{feature}");
            }
        }
    }

    #[test]
    fn a_package_is_packed_with_its_folder() {
        let folder = tempfile::tempdir().unwrap();
        let package = folder.path().join(package("x86_64-unknown-linux-musl"));
        fs::create_dir(&package).unwrap();
        fs::write(package.join("harmony"), "abc").unwrap();
        let archive = pack(&package).unwrap();
        assert!(archive.to_string_lossy().ends_with("-x86_64-unknown-linux-musl.tar.gz"), "{}", archive.display());
        let list = stdout(Command::new("tar").arg("-tzf").arg(&archive)).unwrap();
        let inside = format!("harmony-{}-x86_64-unknown-linux-musl/harmony", env!("CARGO_PKG_VERSION"));
        assert!(list.lines().any(|line| line == inside), "{list}");
    }
}
