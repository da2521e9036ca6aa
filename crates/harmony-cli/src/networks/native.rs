//! The networks as players: loaded when they are first needed, or when somebody checks whether they can be.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use async_trait::async_trait;
use harmony_calls::Cast;
use harmony_models::Model;
use harmony_nets::backend::Backend;
use harmony_nets::clip::ClipImageEncoder;
use harmony_nets::cpu::Cpu;
use harmony_nets::detector::{DetectorError, DetectorSettings, Owlv2Detector, Owlv2Size};
use harmony_nets::lpips::{Lpips, LpipsNet};
use harmony_nets::sam2::{Sam2Segmenter, Sam2Size};
use harmony_nets::vggt::{self, Vggt, VggtEstimator};
use harmony_nets::{NetError, WeightFile};
use harmony_players::check::{Check, Checked};
use harmony_roles::{
    DetectRequest, Detections, Detector, GeometryAnswer, GeometryEstimator, GeometryRequest, PlayerCard, Role,
    RoleError, SegmentRequest, SegmentedMask, Segmenter,
};
use tokio::sync::Mutex;

use super::{Ask, Weights, memory, not_set_up};
use crate::cast::Known;
use crate::config::networks::Device;

type Loaded<T> = (Arc<T>, String);
type Load<T> = dyn Fn() -> Result<Loaded<T>, RoleError> + Send + Sync;

/// A player whose network is loaded once it is needed. Its card does not tell the device: answers hold wherever they
/// were computed.
struct Lazy<T: ?Sized> {
    card: PlayerCard,
    load: Arc<Load<T>>,
    loaded: Mutex<Option<Loaded<T>>>,
}

impl<T: ?Sized + Send + Sync + 'static> Lazy<T> {
    fn new(player: &str, weights: &Weights, load: Arc<Load<T>>) -> Arc<Self> {
        let model = format!("{} {}", weights.name, weights.version).trim_end().to_owned();
        let card = PlayerCard { player: player.to_owned(), model, offline: true, concurrency: 1 };
        Arc::new(Self { card, load, loaded: Mutex::default() })
    }

    async fn get(&self) -> Result<Loaded<T>, RoleError> {
        let mut loaded = self.loaded.lock().await;
        if let Some(loaded) = &*loaded {
            return Ok(loaded.clone());
        }
        let load = Arc::clone(&self.load);
        let outcome = tokio::task::spawn_blocking(move || load()).await;
        let broken = |error| Err(not_set_up(&self.card.player, format!("loading broke off: {error}"), WEIGHTS_HINT));
        Ok(loaded.insert(outcome.unwrap_or_else(broken)?).clone())
    }

    /// Gives the memory back; whoever asks again waits for the network to be loaded again.
    async fn let_go(&self) {
        *self.loaded.lock().await = None;
    }
}

/// What to do about a network that cannot be loaded.
const WEIGHTS_HINT: &str = "`harmony models verify` checks the weights; `device` chooses between cpu and cuda";

/// How a network is loaded: after a look at the memory, its errors being only words.
fn loading<T: ?Sized, E: std::fmt::Display>(
    player: &'static str,
    memory: impl Fn() -> Result<(), RoleError> + Send + Sync + 'static,
    load: impl Fn() -> Result<Loaded<T>, E> + Send + Sync + 'static,
) -> Arc<Load<T>> {
    Arc::new(move || {
        memory()?;
        load().map_err(|error| not_set_up(player, error.to_string(), WEIGHTS_HINT))
    })
}

/// Whether a network with this setting runs on the processor.
fn on_cpu(device: Device) -> bool {
    #[cfg(feature = "cuda")]
    let gpu = device == Device::Cuda || device == Device::Auto && harmony_nets::cuda::check().is_ok();
    #[cfg(not(feature = "cuda"))]
    let gpu = device == Device::Cuda;
    !gpu
}

#[async_trait]
impl<T: ?Sized + Send + Sync + 'static> Check for Lazy<T> {
    async fn check(&self, _paid: bool) -> Result<Checked, RoleError> {
        let start = Instant::now();
        let (_, device) = self.get().await?;
        let seconds = start.elapsed().as_secs_f64();
        Ok(Checked { detail: format!("{} on {device}, loaded in {seconds:.1} s", self.card.model), usage: None })
    }
}

#[async_trait]
impl GeometryEstimator for Lazy<dyn GeometryEstimator> {
    fn card(&self) -> PlayerCard {
        self.card.clone()
    }

    async fn estimate(&self, request: &GeometryRequest) -> Result<GeometryAnswer, RoleError> {
        let answer = self.get().await?.0.estimate(request).await;
        // The largest network is asked once in a run, before all others.
        self.let_go().await;
        answer
    }
}

#[async_trait]
impl Segmenter for Lazy<dyn Segmenter> {
    fn card(&self) -> PlayerCard {
        self.card.clone()
    }

    async fn segment(&self, request: &SegmentRequest) -> Result<Vec<SegmentedMask>, RoleError> {
        self.get().await?.0.segment(request).await
    }
}

#[async_trait]
impl Detector for Lazy<dyn Detector> {
    fn card(&self) -> PlayerCard {
        self.card.clone()
    }

    async fn detect(&self, request: &DetectRequest) -> Result<Detections, RoleError> {
        self.get().await?.0.detect(request).await
    }
}

/// Casts a network for a role.
pub(super) fn play(cast: &mut Cast, ask: &Ask<'_>, weights: &Weights, known: &mut Known) -> Result<(), RoleError> {
    let device = ask.device;
    if device == Device::Cuda && !cfg!(feature = "cuda") {
        return Err(not_set_up(
            &weights.name,
            "`device` is cuda, and this build has no CUDA",
            "build with `--features cuda`, or set `device` to auto",
        ));
    }
    let name = weights.name.clone();
    let path = weights.path.clone();
    let memory = {
        let (role, name, path) = (ask.role, name.clone(), path.clone());
        move || if on_cpu(device) { memory::check(role, &name, &path) } else { Ok(()) }
    };
    let check: Arc<dyn Check> = match ask.role {
        Role::GeometryEstimator => {
            let load = loading("vggt", memory, move || load_vggt(&path, device));
            let player = Lazy::<dyn GeometryEstimator>::new("vggt", weights, load);
            cast.geometry_estimator = player.clone();
            player
        }
        Role::Segmenter => {
            let size = sam2_size(&weights.name).or_else(|| sam2_size(&weights.version)).ok_or_else(|| {
                let hint = "set `model` in [players.segmenter] to sam2.1-large, -base-plus, -small or -tiny";
                not_set_up("sam2", format!("of which size are these weights: {}", path.display()), hint)
            })?;
            let load = loading("sam2", memory, move || load_sam2(&path, size, device));
            let player = Lazy::<dyn Segmenter>::new("sam2", weights, load);
            cast.segmenter = player.clone();
            player
        }
        _ => {
            let large = weights.name.contains("large") || weights.version.contains("large");
            let size = if large { Owlv2Size::Large } else { Owlv2Size::Base };
            let load = loading("owlv2", memory, move || load_owlv2(&path, size, device));
            let player = Lazy::<dyn Detector>::new("owlv2", weights, load);
            cast.detector = player.clone();
            player
        }
    };
    known.checks.push((ask.role, name, check));
    Ok(())
}

fn sam2_size(name: &str) -> Option<Sam2Size> {
    let name = name.to_lowercase().replace('-', "_");
    Sam2Size::ALL.into_iter().find(|size| name.contains(size.name()))
}

/// Runs on the GPU where that is wanted and can be, else on the CPU; the device in words.
#[cfg(feature = "cuda")]
fn on<T: ?Sized, E: From<NetError> + std::fmt::Display>(
    device: Device,
    gpu: impl FnOnce(Arc<harmony_nets::cuda::Cuda>) -> Result<Arc<T>, E>,
    cpu: impl FnOnce(Arc<Cpu>) -> Result<Arc<T>, E>,
) -> Result<Loaded<T>, E> {
    let why = match device {
        Device::Cpu => None,
        Device::Auto | Device::Cuda => match harmony_nets::cuda::Cuda::open(0) {
            Ok(cuda) => {
                let cuda = Arc::new(cuda);
                let words = cuda.device();
                return Ok((gpu(cuda)?, words));
            }
            Err(error) if device == Device::Cuda => return Err(error.into()),
            Err(error) => Some(error),
        },
    };
    let backend = Arc::new(Cpu::new());
    let words = backend.device();
    let words = why.map_or_else(|| words.clone(), |why| format!("{words} (not on a GPU: {why})"));
    Ok((cpu(backend)?, words))
}

#[cfg(not(feature = "cuda"))]
fn on<T: ?Sized, E>(_: Device, cpu: impl FnOnce(Arc<Cpu>) -> Result<Arc<T>, E>) -> Result<Loaded<T>, E> {
    let backend = Arc::new(Cpu::new());
    let words = backend.device();
    Ok((cpu(backend)?, words))
}

fn load_vggt(path: &Path, device: Device) -> Result<Loaded<dyn GeometryEstimator>, NetError> {
    let device = match device {
        Device::Cpu => vggt::Device::Cpu,
        #[cfg(feature = "cuda")]
        Device::Auto => vggt::Device::Best,
        #[cfg(feature = "cuda")]
        Device::Cuda => vggt::Device::Cuda,
        #[cfg(not(feature = "cuda"))]
        _ => vggt::Device::Cpu,
    };
    let estimator = VggtEstimator::load(path, device)?;
    let words = estimator.device();
    Ok((Arc::new(estimator), words))
}

fn load_sam2(path: &Path, size: Sam2Size, device: Device) -> Result<Loaded<dyn Segmenter>, NetError> {
    let cpu = |backend| Ok(Arc::new(Sam2Segmenter::load(path, size, backend)?) as Arc<dyn Segmenter>);
    #[cfg(feature = "cuda")]
    return on(device, |gpu| Ok(Arc::new(Sam2Segmenter::load(path, size, gpu)?) as Arc<dyn Segmenter>), cpu);
    #[cfg(not(feature = "cuda"))]
    on(device, cpu)
}

fn load_owlv2(folder: &Path, size: Owlv2Size, device: Device) -> Result<Loaded<dyn Detector>, DetectorError> {
    let settings = DetectorSettings::default;
    let cpu = |backend| Ok(Arc::new(Owlv2Detector::load(folder, size, backend, settings())?) as Arc<dyn Detector>);
    #[cfg(feature = "cuda")]
    return on(
        device,
        |gpu| Ok(Arc::new(Owlv2Detector::load(folder, size, gpu, settings())?) as Arc<dyn Detector>),
        cpu,
    );
    #[cfg(not(feature = "cuda"))]
    on(device, cpu)
}

/// Loads a model's network and lets it go: its files have the keys and shapes, or the error tells which one has not.
pub(super) fn layout(model: &Model, folder: &Path) -> Result<(), String> {
    let file = |i: usize| folder.join(model.files[i].name);
    let backend = Arc::new(Cpu::new());
    let net = |outcome: Result<(), NetError>| outcome.map_err(|e| e.to_string());
    match model.id {
        id if id.starts_with("vggt") => {
            let weights = WeightFile::open(&file(0)).map_err(|e| e.to_string())?;
            net(Vggt::load(&*backend, &weights.at("")).map(drop))
        }
        id if id.starts_with("sam2") => {
            let size = sam2_size(id).ok_or_else(|| format!("{id} is no size of SAM 2"))?;
            net(Sam2Segmenter::load(&file(0), size, backend).map(drop))
        }
        id if id.starts_with("owlv2") => {
            let size = if id.ends_with("large") { Owlv2Size::Large } else { Owlv2Size::Base };
            let loaded = Owlv2Detector::load(folder, size, backend, DetectorSettings::default());
            loaded.map(drop).map_err(|e| e.to_string())
        }
        "lpips-alex" => net(Lpips::open(&file(0), &file(1), LpipsNet::Alex, backend).map(drop)),
        "lpips-vgg" => net(Lpips::open(&file(0), &file(1), LpipsNet::Vgg, backend).map(drop)),
        id if id.starts_with("clip") => net(ClipImageEncoder::open(&file(0), backend).map(drop)),
        id => Err(format!("no network reads {id}")),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    /// Counts how many of its kind there are.
    struct Counted(Arc<AtomicUsize>);

    impl Drop for Counted {
        fn drop(&mut self) {
            self.0.fetch_sub(1, Ordering::SeqCst);
        }
    }

    #[async_trait]
    impl GeometryEstimator for Counted {
        fn card(&self) -> PlayerCard {
            PlayerCard { player: "counted".into(), model: String::new(), offline: true, concurrency: 1 }
        }

        async fn estimate(&self, _: &GeometryRequest) -> Result<GeometryAnswer, RoleError> {
            assert_eq!(self.0.load(Ordering::SeqCst), 1, "it is there while it works");
            Err(not_set_up("counted", "it knows nothing", ""))
        }
    }

    #[tokio::test]
    async fn the_geometry_network_lets_its_memory_go_and_is_loaded_again_when_asked_again() {
        let (alive, loads) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
        let load = {
            let (alive, loads) = (Arc::clone(&alive), Arc::clone(&loads));
            move || {
                alive.fetch_add(1, Ordering::SeqCst);
                loads.fetch_add(1, Ordering::SeqCst);
                Ok((Arc::new(Counted(Arc::clone(&alive))) as Arc<dyn GeometryEstimator>, "here".to_owned()))
            }
        };
        let weights = Weights { name: "w".into(), path: "w".into(), version: String::new() };
        let player = Lazy::<dyn GeometryEstimator>::new("counted", &weights, Arc::new(load));
        player.check(false).await.unwrap();
        player.check(false).await.unwrap();
        assert_eq!(
            (alive.load(Ordering::SeqCst), loads.load(Ordering::SeqCst)),
            (1, 1),
            "looked at twice, loaded once"
        );
        let request =
            GeometryRequest { name: "g".into(), image: Arc::new(image::RgbImage::new(2, 2)), exif_focal_px: None };
        for asked in 1..=2 {
            assert!(player.estimate(&request).await.is_err());
            assert_eq!((alive.load(Ordering::SeqCst), loads.load(Ordering::SeqCst)), (0, asked));
        }
    }
}
