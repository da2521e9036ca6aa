//! The site and the private folder.
//! Key `study.page`.
//!
//! Paper: "a self-contained static web page", "scenes with a successful render from every method, so each trial is a
//! complete six-way comparison". Every panel of a trial has the same size, format and quality: pictures are encoded
//! anew (no EXIF, no name of a program), fitted into the photo's frame, and named by keyed hashes.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use harmony_io::{picture, read_bounded, write_atomic};
use harmony_scene::ImageSize;
use image::imageops::FilterType;
use image::{DynamicImage, Rgb, RgbImage};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha20Rng;
use rayon::prelude::*;
use sha2::{Digest as _, Sha256};

use crate::page::{PageData, PagePanel, PageTrial, page};
use crate::private::{
    Exclusion, OTHER_ROOM, PARTICIPANTS_FILE, PHOTO_ITSELF, PrivatePanel, PrivateStudy, PrivateTrial, TrialKind, hex,
    keyed, private,
};
use crate::sets::{MAIN_VIEW, RunPicture, SceneFiles, Set};
use crate::shuffle::Generator;
use crate::{FORMAT, StudyError, sets, text};

/// Ground around a picture of another shape than the photo, sRGB.
const GROUND: [u8; 3] = [52, 54, 58];
/// Share by which sides may differ before a panel counts as of another shape.
const SHAPE_TOLERANCE: f64 = 0.02;

/// What to build.
#[derive(Debug, Clone)]
pub struct BuildOptions {
    /// The study's name: `[a-z0-9-]`, part of every seed.
    pub study: String,
    /// Title of the page.
    pub title: String,
    /// Name and folder of each method.
    pub sets: Vec<(String, PathBuf)>,
    /// Folder of photos named by their scenes; else they come from the sets.
    pub photos: Option<PathBuf>,
    /// The method that the others are compared with; else the first.
    pub reference: Option<String>,
    /// So many scenes, drawn at random; else all.
    pub scenes: Option<usize>,
    /// Attention checks.
    pub checks: usize,
    /// Scenes that are shown twice.
    pub repeats: usize,
    /// Invitations.
    pub participants: usize,
    /// Address of the page, for the links of invitations.
    pub url: String,
    /// Instructions; else the paper's.
    pub instructions: Option<String>,
    /// Consent text; else a general one.
    pub consent: Option<String>,
    /// Whom to write to, for the general consent text.
    pub contact: Option<String>,
    /// Which render of runs.
    pub picture: RunPicture,
    /// Longest side of the pictures, pixels.
    pub size: u32,
    /// Quality of the pictures, 1 to 100.
    pub quality: u8,
    /// Everything in one file.
    pub single_file: bool,
    /// Who is left out of the analysis, fixed now.
    pub exclusion: Exclusion,
    /// The same seed, the same bytes; for tests and demonstrations alone, for the secret follows from it.
    pub seed: Option<u64>,
}

impl BuildOptions {
    /// The paper's study of these sets.
    pub fn new(study: &str, sets: Vec<(String, PathBuf)>) -> Self {
        Self {
            study: study.to_owned(),
            title: "Which room matches the photo?".to_owned(),
            sets,
            photos: None,
            reference: None,
            scenes: None,
            checks: 0,
            repeats: 0,
            participants: 16,
            url: "index.html".to_owned(),
            instructions: None,
            consent: None,
            contact: None,
            picture: RunPicture::Flat,
            size: 1280,
            quality: 90,
            single_file: false,
            exclusion: Exclusion::default(),
            seed: None,
        }
    }
}

/// What was built.
#[derive(Debug, Clone)]
pub struct Built {
    /// The decoding map.
    pub study: PrivateStudy,
    /// Bytes of the site.
    pub bytes: u64,
    /// Files of the site.
    pub files: usize,
}

/// A trial before its pictures are made.
struct Plan {
    id: String,
    scene: String,
    kind: TrialKind,
    photo: PathBuf,
    /// Opaque name, method, pictures by view.
    panels: Vec<(String, String, BTreeMap<String, PathBuf>)>,
    /// Views that every panel has, [`MAIN_VIEW`] first.
    views: Vec<String>,
}

/// A picture of the site: path and bytes.
type File = (String, Vec<u8>);

/// Builds a site into a folder that must not exist yet, and the private folder beside it.
///
/// # Errors
/// Whatever is wrong with sets and pictures; nothing is left behind then.
pub fn build(options: &BuildOptions, site: &Path, private_folder: &Path) -> Result<Built, StudyError> {
    for folder in [site, private_folder] {
        if folder.exists() {
            return Err(StudyError::Exists(folder.to_owned()));
        }
    }
    if site.starts_with(private_folder) || private_folder.starts_with(site) {
        return Err(StudyError::Name {
            what: "the private folder",
            name: private_folder.display().to_string(),
            why: "it must not lie in the site, nor the site in it",
        });
    }
    let allowed = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-';
    if options.study.is_empty() || options.study.len() > 40 || !options.study.bytes().all(allowed) {
        return Err(StudyError::Name {
            what: "the study's name",
            name: options.study.clone(),
            why: "1 to 40 characters of a to z, 0 to 9 and -",
        });
    }
    let secret = secret(options.seed);
    let loaded = load_sets(options)?;
    let photos = match &options.photos {
        Some(folder) => sets::photos(folder)?,
        None => BTreeMap::new(),
    };
    let (scenes, left_out) = complete_scenes(&loaded, &photos);
    if scenes.is_empty() {
        return Err(StudyError::NoScenes { missing: left_out });
    }
    let chosen = choose(scenes, options, &secret)?;
    let plans = plan(&chosen, &loaded, options, &secret)?;

    let made: Vec<(PageTrial, Vec<File>, Vec<String>)> =
        plans.par_iter().map(|p| pictures(p, options)).collect::<Result<_, _>>()?;
    let mut notes: Vec<String> =
        made.iter().flat_map(|(_, _, notes)| notes.clone()).collect::<BTreeSet<_>>().into_iter().collect();
    notes.sort();
    let version = version(options, &made);
    let trials = plans.len();
    let mut data = PageData {
        format: FORMAT,
        study: options.study.clone(),
        version: version.clone(),
        title: options.title.clone(),
        instructions: options.instructions.clone().unwrap_or_else(|| text::instructions(trials, options.sets.len())),
        consent: options
            .consent
            .clone()
            .unwrap_or_else(|| text::consent(trials, text::minutes(trials), options.contact.as_deref())),
        trials: Vec::new(),
    };
    let mut files: Vec<File> = Vec::new();
    for (trial, pictures, _) in made {
        data.trials.push(if options.single_file { trial.embedded(&pictures) } else { trial });
        if !options.single_file {
            files.extend(pictures);
        }
    }
    let study = PrivateStudy {
        format: FORMAT,
        study: options.study.clone(),
        version,
        secret,
        methods: options.sets.iter().map(|(name, _)| name.clone()).collect(),
        reference: options.reference.clone().unwrap_or_else(|| options.sets[0].0.clone()),
        exclusion: options.exclusion,
        trials: plans.iter().map(private_trial).collect(),
        left_out,
        notes,
    };
    // The page last: a site without it is none.
    files.push(("index.html".to_owned(), page(&data).into_bytes()));
    let bytes = files.iter().map(|(_, b)| b.len() as u64).sum();
    let count = files.len();
    write_folder(site, &files)?;
    let written =
        write_folder(private_folder, &[(PARTICIPANTS_FILE.to_owned(), invitations(&study, options).into_bytes())])
            .and_then(|()| study.save(private_folder));
    if let Err(error) = written {
        let _ = std::fs::remove_dir_all(site);
        return Err(error);
    }
    private(&private_folder.join(PARTICIPANTS_FILE));
    Ok(Built { study, bytes, files: count })
}

fn secret(seed: Option<u64>) -> String {
    let mut bytes = [0_u8; 32];
    match seed {
        Some(seed) => ChaCha20Rng::seed_from_u64(seed).fill(&mut bytes),
        None => rand::rng().fill(&mut bytes),
    }
    hex(&bytes)
}

fn load_sets(options: &BuildOptions) -> Result<Vec<Set>, StudyError> {
    if !(2..=9).contains(&options.sets.len()) {
        return Err(StudyError::SetCount(options.sets.len()));
    }
    let mut names = BTreeSet::new();
    for (name, _) in &options.sets {
        if !names.insert(name) {
            return Err(StudyError::Name { what: "the set's name", name: name.clone(), why: "it is given twice" });
        }
    }
    if let Some(reference) = options.reference.as_ref().filter(|r| !names.contains(r)) {
        return Err(StudyError::Name {
            what: "the reference",
            name: reference.clone(),
            why: "it must be the name of one of the sets",
        });
    }
    options.sets.iter().map(|(name, folder)| sets::load(name, folder, options.picture)).collect()
}

/// Scenes with a photo and a picture of every method, with their photos; and why others were left out.
fn complete_scenes(sets: &[Set], photos: &BTreeMap<String, PathBuf>) -> (Vec<(String, PathBuf)>, Vec<String>) {
    let all: BTreeSet<&String> = sets.iter().flat_map(|s| s.scenes.keys()).collect();
    let (mut complete, mut left_out) = (Vec::new(), Vec::new());
    for scene in all {
        let missing: Vec<&str> =
            sets.iter().filter(|s| !s.scenes.contains_key(scene)).map(|s| s.name.as_str()).collect();
        let photo = photos
            .get(scene)
            .cloned()
            .or_else(|| sets.iter().find_map(|s| s.scenes.get(scene).and_then(|f| f.photo.clone())));
        match (missing.is_empty(), photo) {
            (true, Some(photo)) => complete.push((scene.clone(), photo)),
            (true, None) => left_out.push(format!("{scene}: no photo")),
            (false, _) => left_out.push(format!("{scene}: nothing of {}", missing.join(", "))),
        }
    }
    (complete, left_out)
}

/// So many scenes as asked for, by lot.
fn choose(
    mut scenes: Vec<(String, PathBuf)>,
    options: &BuildOptions,
    secret: &str,
) -> Result<Vec<(String, PathBuf)>, StudyError> {
    let few = |what, wanted, found| Err(StudyError::TooFewScenes { what, wanted, found });
    if let Some(wanted) = options.scenes {
        if wanted == 0 || wanted > scenes.len() {
            return few("scenes", wanted, scenes.len());
        }
        Generator::from_text(&format!("harmony-study scenes\n{secret}")).shuffle(&mut scenes);
        scenes.truncate(wanted);
        scenes.sort();
    }
    if options.repeats > scenes.len() {
        return few("repeated scenes", options.repeats, scenes.len());
    }
    if options.checks > 0 && (scenes.len() < 2 || options.checks > scenes.len()) {
        return few("attention checks (each needs two scenes)", options.checks, scenes.len());
    }
    Ok(scenes)
}

fn plan(
    scenes: &[(String, PathBuf)],
    sets: &[Set],
    options: &BuildOptions,
    secret: &str,
) -> Result<Vec<Plan>, StudyError> {
    let lot = |what: &str| {
        let mut order: Vec<usize> = (0..scenes.len()).collect();
        Generator::from_text(&format!("harmony-study {what}\n{secret}")).shuffle(&mut order);
        order
    };
    let files = |set: &Set, scene: &str| -> SceneFiles { set.scenes.get(scene).cloned().unwrap_or_default() };
    let opaque = |text: String| hex(&keyed(secret.as_bytes(), &text)[..8]);
    let mut plans = Vec::new();
    let mut add = |scene: &str, photo: &Path, kind: TrialKind, panels: Vec<(String, BTreeMap<String, PathBuf>)>| {
        let which = match kind {
            TrialKind::Scene => "scene",
            TrialKind::Repeat => "repeat",
            TrialKind::Check => "check",
        };
        let mut panels: Vec<(String, String, BTreeMap<String, PathBuf>)> = panels
            .into_iter()
            .map(|(method, views)| (opaque(format!("panel\n{which}\n{scene}\n{method}")), method, views))
            .collect();
        panels.sort();
        let mut views = vec![MAIN_VIEW.to_owned()];
        if let Some((_, _, first)) = panels.first() {
            let shared = |view: &&String| *view != MAIN_VIEW && panels.iter().all(|(_, _, v)| v.contains_key(*view));
            views.extend(first.keys().filter(shared).cloned());
        }
        let id = opaque(format!("trial\n{which}\n{scene}"));
        plans.push(Plan { id, scene: scene.to_owned(), kind, photo: photo.to_owned(), panels, views });
    };
    for (scene, photo) in scenes {
        let panels = sets.iter().map(|s| (s.name.clone(), files(s, scene).views)).collect();
        add(scene, photo, TrialKind::Scene, panels);
    }
    for i in lot("repeats").into_iter().take(options.repeats) {
        let (scene, photo) = &scenes[i];
        let panels = sets.iter().map(|s| (s.name.clone(), files(s, scene).views)).collect();
        add(scene, photo, TrialKind::Repeat, panels);
    }
    let order = lot("checks");
    for (n, i) in order.iter().copied().enumerate().take(options.checks) {
        let (scene, photo) = &scenes[i];
        // Two methods, by lot, give their places to the photo and to another room.
        let mut places: Vec<usize> = (0..sets.len()).collect();
        Generator::from_text(&format!("harmony-study places {n}\n{secret}")).shuffle(&mut places);
        let other = &scenes[order[(n + 1) % order.len()]].0;
        let only_main =
            |path: Option<PathBuf>| path.map(|p| BTreeMap::from([(MAIN_VIEW.to_owned(), p)])).unwrap_or_default();
        let panels = sets
            .iter()
            .enumerate()
            .map(|(k, set)| {
                if k == places[0] {
                    (PHOTO_ITSELF.to_owned(), only_main(Some(photo.clone())))
                } else if k == places[1] {
                    (OTHER_ROOM.to_owned(), only_main(files(set, other).views.get(MAIN_VIEW).cloned()))
                } else {
                    (set.name.clone(), only_main(files(set, scene).views.get(MAIN_VIEW).cloned()))
                }
            })
            .collect();
        add(scene, photo, TrialKind::Check, panels);
    }
    // By opaque name: the list tells nothing about kinds.
    plans.sort_by(|a, b| a.id.cmp(&b.id));
    if plans.windows(2).any(|w| w[0].id == w[1].id) {
        return Err(StudyError::Name {
            what: "the secret",
            name: String::new(),
            why: "two names collide; build again",
        });
    }
    Ok(plans)
}

/// The pictures of a trial, its entry in the page, and what a reader should know.
fn pictures(plan: &Plan, options: &BuildOptions) -> Result<(PageTrial, Vec<File>, Vec<String>), StudyError> {
    let photo = read_upright(&plan.photo)?;
    let size = ImageSize::new(photo.width(), photo.height()).fit_within(options.size);
    let encode = |path: &Path, image: &RgbImage| {
        picture::rgb_jpeg(image, options.quality)
            .map_err(|source| StudyError::Picture { path: path.to_owned(), source })
    };
    let mut notes = Vec::new();
    let mut files = Vec::new();
    let photo_path = format!("pictures/{}.jpg", plan.id);
    files.push((photo_path.clone(), encode(&plan.photo, &fitted(&photo, size))?));
    let mut panels = Vec::new();
    for (id, method, views) in &plan.panels {
        let mut shown = Vec::new();
        for (n, view) in plan.views.iter().enumerate() {
            let Some(path) = views.get(view) else { continue };
            let image = read_upright(path)?;
            if view == MAIN_VIEW && other_shape(&image, size) {
                notes.push(format!(
                    "{method}: {} x {} is of another shape than the photo of {} and gets bars, by which it can be recognised",
                    image.width(),
                    image.height(),
                    plan.scene
                ));
            }
            let name = format!("pictures/{id}-{n}.jpg");
            files.push((name.clone(), encode(path, &fitted(&image, size))?));
            shown.push(name);
        }
        panels.push(PagePanel { id: id.clone(), views: shown });
    }
    let trial = PageTrial {
        id: plan.id.clone(),
        size: [size.width, size.height],
        photo: photo_path,
        views: plan.views.clone(),
        panels,
    };
    Ok((trial, files, notes))
}

/// A picture as people see it: its orientation applied.
fn read_upright(path: &Path) -> Result<RgbImage, StudyError> {
    let bytes = read_bounded(path, picture::MAX_IMAGE_BYTES)?;
    match harmony_io::photo_from_bytes(bytes) {
        Ok(photo) => Ok(photo.image),
        // Renders may be smaller than photos are allowed to be.
        Err(_) => {
            Ok(picture::read(path).map_err(|source| StudyError::Picture { path: path.to_owned(), source })?.to_rgb8())
        }
    }
}

fn other_shape(image: &RgbImage, size: ImageSize) -> bool {
    let ratio = |w: u32, h: u32| f64::from(w) / f64::from(h.max(1));
    (ratio(image.width(), image.height()) / ratio(size.width, size.height)).ln().abs() > SHAPE_TOLERANCE
}

/// The picture in a frame of this size: its shape is kept, bars fill the rest.
fn fitted(image: &RgbImage, size: ImageSize) -> RgbImage {
    let k = (f64::from(size.width) / f64::from(image.width())).min(f64::from(size.height) / f64::from(image.height()));
    let (mut w, mut h) = (
        ((f64::from(image.width()) * k).round() as u32).clamp(1, size.width),
        ((f64::from(image.height()) * k).round() as u32).clamp(1, size.height),
    );
    if !other_shape(image, size) {
        (w, h) = (size.width, size.height);
    }
    let small = if (w, h) == image.dimensions() {
        image.clone()
    } else {
        DynamicImage::ImageRgb8(image.clone()).resize_exact(w, h, FilterType::CatmullRom).to_rgb8()
    };
    if (w, h) == (size.width, size.height) {
        return small;
    }
    let mut frame = RgbImage::from_pixel(size.width, size.height, Rgb(GROUND));
    image::imageops::replace(&mut frame, &small, i64::from((size.width - w) / 2), i64::from((size.height - h) / 2));
    frame
}

/// Changes with whatever a participant sees.
fn version(options: &BuildOptions, made: &[(PageTrial, Vec<File>, Vec<String>)]) -> String {
    let mut hash = Sha256::new();
    for text in [&options.study, &options.title] {
        hash.update(text.as_bytes());
        hash.update([0]);
    }
    for (_, files, _) in made {
        for (path, bytes) in files {
            hash.update(path.as_bytes());
            hash.update(Sha256::digest(bytes));
        }
    }
    hex(&hash.finalize()[..6])
}

fn private_trial(plan: &Plan) -> PrivateTrial {
    PrivateTrial {
        id: plan.id.clone(),
        scene: plan.scene.clone(),
        kind: plan.kind.clone(),
        panels: plan
            .panels
            .iter()
            .map(|(id, method, _)| PrivatePanel { id: id.clone(), method: method.clone() })
            .collect(),
    }
}

/// `participants.csv`.
fn invitations(study: &PrivateStudy, options: &BuildOptions) -> String {
    let mut text = "code,key,link\n".to_owned();
    for i in 0..options.participants {
        let code = code(&study.secret, i);
        let key = study.invitation(&code);
        text.extend([code.as_str(), ",", &key, ",", &options.url, "#p=", &code, "&k=", &key, "\n"]);
    }
    text
}

/// The code of invitation `i`: nine characters that are not mistaken for one another.
pub fn code(secret: &str, i: usize) -> String {
    const LETTERS: &[u8; 32] = b"abcdefghijkmnpqrstuvwxyz23456789";
    let hash = keyed(secret.as_bytes(), &format!("code\n{i}"));
    let mut code: String = hash[..8].iter().map(|b| char::from(LETTERS[usize::from(b % 32)])).collect();
    code.insert(4, '-');
    code
}

/// Writes a folder whole: under another name first.
fn write_folder(folder: &Path, files: &[File]) -> Result<(), StudyError> {
    let fail = |source| StudyError::File(harmony_io::FileError::Write { path: folder.to_owned(), source });
    let name = folder.file_name().map_or_else(|| "site".into(), |n| n.to_string_lossy().into_owned());
    let temporary = folder.with_file_name(format!(".{name}.{}.0.tmp", std::process::id()));
    let _ = std::fs::remove_dir_all(&temporary);
    let written = files
        .par_iter()
        .try_for_each(|(path, bytes)| write_atomic(&temporary.join(path), bytes))
        .map_err(StudyError::from)
        .and_then(|()| std::fs::rename(&temporary, folder).map_err(fail));
    if written.is_err() {
        let _ = std::fs::remove_dir_all(&temporary);
    }
    written
}
