//! CLIP and LPIPS as judges of pictures.

use std::path::Path;
use std::sync::Arc;

use harmony_bench::metrics::similarity::{Alike, Looking, Similarity};
use harmony_eval::score::{Looks, MetricError, MetricId, PictureMetric};
use harmony_models::{Store, table};
use harmony_nets::NetError;
use harmony_nets::clip::{ClipImageEncoder, cosine};
use harmony_nets::cpu::Cpu;
use harmony_nets::lpips::{Lpips, LpipsNet};
use image::RgbImage;

use super::{Here, state};

/// The networks that are there.
struct Judges {
    clip: Option<ClipImageEncoder<Cpu>>,
    lpips: Option<Lpips<Cpu>>,
}

impl std::fmt::Debug for Judges {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Judges {{ clip: {}, lpips: {} }}", self.clip.is_some(), self.lpips.is_some())
    }
}

impl Similarity for Judges {
    fn compare(&self, render: &RgbImage, target: &RgbImage) -> Alike {
        let n_clip = |clip: &ClipImageEncoder<Cpu>| match &clip.embed(&[render, target]).ok()?[..] {
            [a, b] => Some(1.0 - cosine(a, b)),
            _ => None,
        };
        Alike {
            n_clip: self.clip.as_ref().and_then(n_clip).filter(|v| v.is_finite()),
            lpips: self.lpips.as_ref().and_then(|l| l.distance(render, target).ok()).map(|d| d.value),
        }
    }
}

/// Loads what is there; what is not is told.
pub fn looking(store: &Store) -> Looking {
    let backend = Arc::new(Cpu::new());
    let mut absent = Vec::new();
    let clip = load(store, "clip-vit-b32", "N-CLIP", &mut absent, |folder, files| {
        ClipImageEncoder::open(&folder.join(files[0]), Arc::clone(&backend))
    });
    let lpips = load(store, "lpips-alex", "LPIPS", &mut absent, |folder, files| {
        Lpips::open(&folder.join(files[0]), &folder.join(files[1]), LpipsNet::Alex, Arc::clone(&backend))
    });
    let any = clip.is_some() || lpips.is_some();
    let similarity = any.then(|| Arc::new(Judges { clip, lpips }) as Arc<dyn Similarity>);
    Looking { similarity, absent }
}

/// N-CLIP for `harmony eval`.
struct NClip(ClipImageEncoder<Cpu>);

/// LPIPS for `harmony eval`.
struct Perceptual(Lpips<Cpu>, MetricId);

impl std::fmt::Debug for NClip {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("NClip")
    }
}

impl std::fmt::Debug for Perceptual {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Perceptual({:?})", self.1)
    }
}

impl PictureMetric for NClip {
    fn id(&self) -> MetricId {
        MetricId::NClip
    }

    fn measure(&self, render: &RgbImage, photo: &RgbImage) -> Result<f64, MetricError> {
        let refused = |reason: String| MetricError { metric: MetricId::NClip, reason };
        match &self.0.embed(&[render, photo]).map_err(|e| refused(e.to_string()))?[..] {
            [a, b] => Ok(1.0 - cosine(a, b)),
            other => Err(refused(format!("{} features for two pictures", other.len()))),
        }
    }
}

impl PictureMetric for Perceptual {
    fn id(&self) -> MetricId {
        self.1
    }

    fn measure(&self, render: &RgbImage, photo: &RgbImage) -> Result<f64, MetricError> {
        let distance = self.0.distance(render, photo);
        distance.map(|d| d.value).map_err(|e| MetricError { metric: self.1, reason: e.to_string() })
    }
}

/// The figures of `harmony eval`: what is there is loaded, what is not is told.
pub fn looks(store: &Store) -> Looks {
    let backend = Arc::new(Cpu::new());
    let mut absent = Vec::new();
    let mut metrics: Vec<Arc<dyn PictureMetric>> = Vec::new();
    let clip = load(store, "clip-vit-b32", MetricId::NClip.title(), &mut absent, |folder, files| {
        ClipImageEncoder::open(&folder.join(files[0]), Arc::clone(&backend))
    });
    metrics.extend(clip.map(|clip| Arc::new(NClip(clip)) as Arc<dyn PictureMetric>));
    for (id, net, model) in
        [(MetricId::LpipsAlex, LpipsNet::Alex, "lpips-alex"), (MetricId::LpipsVgg, LpipsNet::Vgg, "lpips-vgg")]
    {
        let lpips = load(store, model, id.title(), &mut absent, |folder, files| {
            Lpips::open(&folder.join(files[0]), &folder.join(files[1]), net, Arc::clone(&backend))
        });
        metrics.extend(lpips.map(|lpips| Arc::new(Perceptual(lpips, id)) as Arc<dyn PictureMetric>));
    }
    Looks::new(metrics, absent)
}

fn load<T>(
    store: &Store,
    id: &str,
    figure: &str,
    absent: &mut Vec<String>,
    open: impl FnOnce(&Path, &[&str]) -> Result<T, NetError>,
) -> Option<T> {
    let model = table::find(id)?;
    let names: Vec<&str> = model.files.iter().map(|f| f.name).collect();
    let outcome = match state(store, model) {
        Ok(Here::Yes { .. }) => {
            // What was copied here by hand is checked once.
            let checked = model.files.iter().try_for_each(|file| match store.state(model, file)? {
                harmony_models::FileState::Verified(_) => Ok(()),
                _ => store.verify(model, file, &|_| {}).map(drop),
            });
            checked
                .map_err(|e| e.to_string())
                .and_then(|()| open(&store.folder().join(id), &names).map_err(|e| e.to_string()))
        }
        Ok(Here::No) => Err(format!("no weights of {id} in {}", store.folder().display())),
        Ok(Here::Wrong(reason)) => Err(reason),
        Err(error) => Err(error.to_string()),
    };
    outcome.map_err(|reason| absent.push(format!("{figure} is not measured: {reason} (harmony models pull {id})"))).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_said_figure_by_figure() {
        let folder = tempfile::tempdir().unwrap();
        let found = looking(&Store::new(folder.path()));
        assert!(found.similarity.is_none());
        assert_eq!(found.absent.len(), 2);
        assert!(
            found.absent[0].contains("N-CLIP") && found.absent[0].contains("pull clip-vit-b32"),
            "{:?}",
            found.absent
        );
        assert!(found.absent[1].contains("LPIPS") && found.absent[1].contains("pull lpips-alex"), "{:?}", found.absent);
        let found = looks(&Store::new(folder.path()));
        let ids: Vec<MetricId> = found.metrics.iter().map(|m| m.id()).collect();
        assert_eq!(ids, [MetricId::Pl], "it needs no weights");
        assert_eq!(found.absent.len(), 3);
        assert!(
            found.absent[2].contains("LPIPS vgg") && found.absent[2].contains("pull lpips-vgg"),
            "{:?}",
            found.absent
        );
    }
}
