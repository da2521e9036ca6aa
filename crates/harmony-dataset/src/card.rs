//! The card: `README.md` with the head that hubs read, and `ATTRIBUTION.md`.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use crate::config::Config;
use crate::layout::Split;
use crate::licences;
use crate::records::Record;
use crate::sources::YesNo;
use crate::stats::Stats;

/// `README.md`.
pub fn card(config: &Config, records: &[Record], stats: &Stats) -> String {
    let scenes = records.len();
    let size = match scenes {
        0..1000 => "n<1K",
        1000..10_000 => "1K<n<10K",
        10_000..100_000 => "10K<n<100K",
        _ => "100K<n<1M",
    };
    let known = licences::find(&config.licence);
    let licence = known.map_or_else(|| "other".to_owned(), |l| l.id.to_ascii_lowercase());
    let objects: usize = stats.objects.iter().flatten().sum();
    let mut out = format!(
        "---\nlicense: {licence}\ntask_categories:\n- image-to-3d\ntags:\n- 3d\n- indoor-scene\n- \
         single-image-reconstruction\nsize_categories:\n- {size}\nconfigs:\n- config_name: scenes\n  data_files: \
         index.parquet\n- config_name: objects\n  data_files: objects.parquet\n---\n# {}\n\nVersion {}. {}\n\n",
        config.name, config.version, config.description
    );
    let _ = writeln!(
        out,
        "{scenes} scenes with {objects} objects.\n\n![room types, objects per scene, levels](stats.svg)\n"
    );
    out.push_str("| split | scenes | objects a scene |\n|---|---|---|\n");
    for (k, split) in Split::ALL.iter().enumerate() {
        let n = stats.scenes[k];
        let mean = stats.objects[k].iter().sum::<usize>() as f64 / n.max(1) as f64;
        let _ = writeln!(out, "| `{}` | {n} | {mean:.1} |", split.name());
    }
    out.push_str(
        "\n## A scene\nEach `<split>/<room_type>_NN/` holds:\n\n| file | what |\n|---|---|\n| `photo.jpg` or `.png` | the photo \
         without metadata; absent where its licence does not let it be published (`sources.csv` has address and hash) |\n| \
         `render.png` | the reconstruction from the photo's camera, physically lit where `provenance.json` says `path-traced` \
         |\n| `render_flat.png`, `canonical.png` | the same in even light; the canonical elevated view |\n| `scene.glb`, \
         `scene.json` | the reconstruction: shell, wall-mounted, furniture, ceiling, decorations |\n| `camera.json` | the \
         calibrated camera (OpenCV axes) |\n| `segmentation.png`, `segmentation.json`, `masks/` | one solid colour an object; \
         colour, stage, type, phrase and mask file of each |\n| `objects.json` | size, position, wall affinity and relations of \
         each object |\n| `provenance.json` | who made what |\n\nMetres; the room's frame is glTF's: +X along the back wall, +Y up, \
         +Z away from it.\n\n## In bulk\n`index.parquet` and `objects.parquet` have a row a scene and an object; `shards/` has \
         WebDataset tar files; `splits/` has lists for training, validation and test, drawn by the photo's hash; \
         `croissant.json` describes both tables; `SHA256SUMS` has every file.\n\n## Limits\nReconstructions are estimates from one \
         photo, not measurements: what no photo shows is invented, and `scene.json` has a confidence for each object.\n\n## \
         Licence\n",
    );
    let held = records.iter().filter(|r| r.source.redistributable == YesNo::No).count();
    let link = known.map_or_else(String::new, |l| format!(" ({})", l.url));
    let _ = writeln!(
        out,
        "The data set as a whole: {}{link}. Photos keep their own licences, see `sources.csv` and `ATTRIBUTION.md`; {held} photos \
         are not included. Meshes, textures and weights: `manifest.json`.",
        config.licence
    );
    if !config.cite_as.is_empty() {
        let _ = writeln!(out, "\n## Citation\n```\n{}\n```", config.cite_as);
    }
    out
}

/// `ATTRIBUTION.md`: photos by licence, then makers.
pub fn attribution(config: &Config, records: &[Record]) -> String {
    let mut by_licence: BTreeMap<&str, Vec<&Record>> = BTreeMap::new();
    for record in records {
        by_licence.entry(&record.source.licence).or_default().push(record);
    }
    let line = |text: &str| text.replace(['\n', '\r', '|'], " ");
    let mut out = format!("# Attribution of {} {}\n\n## Photos\n", config.name, config.version);
    for (licence, records) in by_licence {
        let url = licences::find(licence).map_or("", |l| l.url);
        let own = records.iter().map(|r| r.source.licence_url.as_str()).find(|u| !u.is_empty()).unwrap_or(url);
        let _ = writeln!(out, "\n### {}\n{own}\n", line(licence));
        for r in records {
            let s = &r.source;
            let by = if s.author.is_empty() { String::new() } else { format!(" by {}", line(&s.author)) };
            let changed = if s.blur.is_empty() { "" } else { "; changed: regions blurred" };
            let absent = if s.redistributable == YesNo::No { "; not included" } else { "" };
            let _ =
                writeln!(out, "- `{}`{by}, {} {}{changed}{absent}", r.id.path(), line(&s.source), line(&s.source_url));
        }
    }
    out.push_str("\n## Meshes, textures, weights\n\n");
    let used: std::collections::BTreeSet<String> = records.iter().flat_map(|r| r.provenance.makers()).collect();
    for name in used {
        if let Some(maker) = config.makers.get(&name) {
            let note = if maker.note.is_empty() { String::new() } else { format!(" ({})", line(&maker.note)) };
            let _ = writeln!(out, "- {}: {}, {}{note}", line(&name), line(&maker.licence), maker.url);
        }
    }
    out
}
