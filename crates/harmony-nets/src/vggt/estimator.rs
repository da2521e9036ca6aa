//! VGGT as the geometry estimator, in our conventions.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use async_trait::async_trait;
use glam::{DMat3, DQuat, DVec2, DVec3, Vec3};
use harmony_roles::{GeometryAnswer, GeometryEstimator, GeometryRequest, PlayerCard, RoleError};
use harmony_scene::{ImageSize, Intrinsics, PointMap, PointMapKind};
use image::RgbImage;

use super::preprocess::{Frame, Photo, WIDTH, preprocess};
use super::{FrameGeometry, Heads, Vggt};
use crate::cpu::Cpu;
use crate::{Backend, NetError, WeightFile};

/// Fields of view outside of these, in degrees, are nonsense.
const FOV_DEG: [f64; 2] = [2.0, 170.0];
/// At least this share of pixels needs a usable depth.
const MIN_DEPTH: f64 = 0.5;
/// Width to height of a pixel beyond these is nonsense; point maps outside of them can't be recorded either.
const PIXEL_ASPECT: [f64; 2] = [0.25, 4.0];
/// Depths nearer than this are no depths (the reference's limit).
const NEAREST: f32 = 1e-8;

/// Where to run a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Device {
    /// All threads of rayon's pool.
    #[default]
    Cpu,
    /// The first NVIDIA GPU; an error that says what is missing when there is none to be used.
    #[cfg(feature = "cuda")]
    Cuda,
    /// The first NVIDIA GPU when it can be used and has the memory, else the CPU; [`VggtEstimator::device`] says which and why.
    #[cfg(feature = "cuda")]
    Best,
}

/// A network on a device, whichever that is.
trait Estimate: Send + Sync {
    fn device(&self) -> String;
    fn run(&self, frames: &[Frame]) -> Result<Vec<FrameGeometry>, NetError>;
}

struct On<B: Backend> {
    backend: B,
    network: Vggt<B>,
    /// One pass at a time: a pass uses the whole device, and what others launch must not get into a recording.
    turn: Mutex<()>,
}

impl<B: Backend> Estimate for On<B> {
    fn device(&self) -> String {
        self.backend.device()
    }

    fn run(&self, frames: &[Frame]) -> Result<Vec<FrameGeometry>, NetError> {
        let _turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
        // Points come from the depth, which the authors recommend over the point head.
        self.network.run(&self.backend, frames, Heads { depth: true, points: false })
    }
}

/// A network on a device with little memory, and how to get it onto one with more.
#[cfg(any(feature = "cuda", test))]
struct OrCpu {
    first: Arc<dyn Estimate>,
    other: Box<dyn Fn() -> Result<Arc<dyn Estimate>, NetError> + Send + Sync>,
    /// The other one, and why.
    gone: Mutex<Option<(Arc<dyn Estimate>, String)>>,
}

#[cfg(any(feature = "cuda", test))]
impl Estimate for OrCpu {
    fn device(&self) -> String {
        match &*self.gone.lock().unwrap_or_else(PoisonError::into_inner) {
            Some((other, why)) => format!("{}; no longer on a GPU: {why}", other.device()),
            None => self.first.device(),
        }
    }

    fn run(&self, frames: &[Frame]) -> Result<Vec<FrameGeometry>, NetError> {
        let mut gone = self.gone.lock().unwrap_or_else(PoisonError::into_inner);
        if gone.is_none() {
            match self.first.run(frames) {
                Err(why @ NetError::OutOfMemory { .. }) => *gone = Some(((self.other)()?, why.to_string())),
                answer => return answer,
            }
        }
        let other = gone.as_ref().map(|(other, _)| Arc::clone(other));
        drop(gone);
        other.unwrap_or_else(|| Arc::clone(&self.first)).run(frames)
    }
}

/// VGGT as a player.
#[derive(Clone)]
pub struct VggtEstimator {
    network: Arc<dyn Estimate>,
    model: String,
    patch: usize,
    /// Why it is not on the device that would be quicker.
    note: Option<String>,
}

impl VggtEstimator {
    /// Loads a weight file (safetensors, or a checkpoint of PyTorch, with the keys of VGGT-1B) onto a device.
    ///
    /// # Errors
    /// [`NetError`]; weights that do not fit name the file, the key, the wanted and the found shape.
    pub fn load(path: &Path, device: Device) -> Result<Self, NetError> {
        let file = WeightFile::open(path)?;
        match device {
            Device::Cpu => Self::on(Cpu::new(), &file),
            #[cfg(feature = "cuda")]
            Device::Cuda => Self::on(crate::cuda::Cuda::open(0)?, &file),
            #[cfg(feature = "cuda")]
            Device::Best => match crate::cuda::Cuda::open(0).and_then(|cuda| Self::on(cuda, &file)) {
                Err(reason @ (NetError::Device { .. } | NetError::OutOfMemory { .. })) => {
                    Ok(Self { note: Some(reason.to_string()), ..Self::on(Cpu::new(), &file)? })
                }
                Ok(gpu) => Ok(gpu.or_cpu(move || Self::on(Cpu::new(), &file).map(|cpu| cpu.network))),
                Err(other) => Err(other),
            },
        }
    }

    /// The same, going over to another device for good when this one runs out of memory: more photos take more.
    #[cfg(any(feature = "cuda", test))]
    fn or_cpu(self, other: impl Fn() -> Result<Arc<dyn Estimate>, NetError> + Send + Sync + 'static) -> Self {
        let network = OrCpu { first: self.network, other: Box::new(other), gone: Mutex::default() };
        Self { network: Arc::new(network), ..self }
    }

    /// Loads onto a backend of one's own.
    ///
    /// # Errors
    /// As [`VggtEstimator::load`].
    pub fn on<B: Backend + 'static>(backend: B, file: &WeightFile) -> Result<Self, NetError> {
        let network = Vggt::load(&backend, &file.at(""))?;
        let name = file.path().file_name().map_or_else(|| "weights".into(), |n| n.to_string_lossy().into_owned());
        let patch = network.config().patch;
        Ok(Self {
            network: Arc::new(On { backend, network, turn: Mutex::new(()) }),
            model: format!("VGGT {name}"),
            patch,
            note: None,
        })
    }

    /// The device it runs on, for people.
    pub fn device(&self) -> String {
        let device = self.network.device();
        self.note.as_ref().map_or_else(|| device.clone(), |why| format!("{device}; not on a GPU: {why}"))
    }

    /// Point maps of several photos of one room, in one common frame. All photos have one shape after preprocessing.
    ///
    /// # Errors
    /// [`RoleError::UnusableAnswer`] when the network's answer is nonsense, [`RoleError::NotCapable`] for photos that it
    /// cannot take together, [`RoleError::Unavailable`] when the device fails.
    pub fn estimate_photos(&self, photos: &[&RgbImage]) -> Result<Vec<PointMap>, RoleError> {
        let frames: Vec<Frame> = photos
            .iter()
            .map(|photo| {
                let (width, height) = (photo.width() as usize, photo.height() as usize);
                preprocess(Photo { width, height, rgb: photo.as_raw() }, WIDTH, self.patch)
            })
            .collect();
        let player = || "vggt".to_owned();
        let geometry = self.network.run(&frames).map_err(|e| match e {
            NetError::Input { reason, .. } => RoleError::NotCapable { player: player(), reason },
            other => {
                RoleError::Unavailable { player: player(), reason: other.to_string(), status: None, retry_after: None }
            }
        })?;
        frames
            .iter()
            .zip(&geometry)
            .map(|(frame, geometry)| {
                point_map(frame, geometry).map_err(|complaint| RoleError::UnusableAnswer {
                    player: player(),
                    complaint,
                    raw: format!("pose {:?}", geometry.pose),
                })
            })
            .collect()
    }
}

#[async_trait]
impl GeometryEstimator for VggtEstimator {
    fn card(&self) -> PlayerCard {
        PlayerCard { player: "vggt".into(), model: self.model.clone(), offline: true, concurrency: 1 }
    }

    async fn estimate(&self, request: &GeometryRequest) -> Result<GeometryAnswer, RoleError> {
        let (this, image) = (self.clone(), Arc::clone(&request.image));
        let maps = tokio::task::spawn_blocking(move || this.estimate_photos(&[&image])).await.map_err(|e| {
            let reason = format!("the network's thread ended: {e}");
            RoleError::Unavailable { player: "vggt".into(), reason, status: None, retry_after: None }
        })??;
        let map = maps
            .into_iter()
            .next()
            .ok_or_else(|| RoleError::NotCapable { player: "vggt".into(), reason: "no answer for the photo".into() })?;
        Ok(GeometryAnswer::Points(Arc::new(map)))
    }
}

/// The network's answer for one frame as a point map, or what is wrong with it.
///
/// The network unprojects with integer pixel indices `u, v` and the principal point `(W/2, H/2)`. In our frame the
/// centre of pixel `u` is at `u + 0.5`, so the same rays have the principal point at `(W/2 + 0.5, H/2 + 0.5)`, less what
/// was padded at the left and the top. Points are unprojected from the depth with the network's own camera.
fn point_map(frame: &Frame, geometry: &FrameGeometry) -> Result<PointMap, String> {
    let pose = geometry.pose.map(f64::from);
    if pose.iter().any(|v| !v.is_finite()) {
        return Err(format!("the camera is not finite: {pose:?}"));
    }
    let [tx, ty, tz, qx, qy, qz, qw, fov_y, fov_x] = pose;
    for fov in [fov_y, fov_x] {
        if !(FOV_DEG[0]..=FOV_DEG[1]).contains(&fov.to_degrees()) {
            return Err(format!("a field of view of {:.2} degrees", fov.to_degrees()));
        }
    }
    let quaternion = DQuat::from_xyzw(qx, qy, qz, qw);
    if quaternion.length() < 1e-6 {
        return Err("the camera has no direction".into());
    }
    let rotation = DMat3::from_quat(quaternion.normalize());
    let translation = DVec3::new(tx, ty, tz);
    let (w, h) = (frame.width as f64, frame.height as f64);
    let [left, top, columns, rows] = frame.photo;
    let intrinsics = Intrinsics {
        fx: w / 2.0 / (fov_x / 2.0).tan(),
        fy: h / 2.0 / (fov_y / 2.0).tan(),
        cx: w / 2.0 + 0.5 - left as f64,
        cy: h / 2.0 + 0.5 - top as f64,
    };
    if !(PIXEL_ASPECT[0]..=PIXEL_ASPECT[1]).contains(&(intrinsics.fx / intrinsics.fy)) {
        let [x, y] = [fov_x, fov_y].map(f64::to_degrees);
        return Err(format!("fields of view of {x:.1} by {y:.1} degrees for {w} by {h} pixels"));
    }
    let mut xyz = Vec::with_capacity(rows * columns);
    let mut confidence = Vec::with_capacity(rows * columns);
    for y in 0..rows {
        for x in 0..columns {
            let at = (top + y) * frame.width + left + x;
            let (depth, sure) = (geometry.depth[at], geometry.depth_confidence[at]);
            let ray = intrinsics.direction(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
            let point = (rotation.transpose() * (ray * f64::from(depth) - translation)).as_vec3();
            let usable = depth.is_finite() && depth > NEAREST && sure.is_finite() && point.is_finite();
            xyz.push(if usable { point } else { Vec3::NAN });
            confidence.push(if usable { sure } else { 0.0 });
        }
    }
    let usable = confidence.iter().filter(|c| **c > 0.0).count();
    if (usable as f64) < MIN_DEPTH * (rows * columns) as f64 {
        return Err(format!("only {usable} of {} pixels have a depth", rows * columns));
    }
    let size = ImageSize::new(columns as u32, rows as u32);
    Ok(PointMap { kind: PointMapKind::Relative, size, xyz, confidence, intrinsics, rotation, translation })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(width: usize, height: usize, photo: [usize; 4]) -> Frame {
        Frame { width, height, rgb: vec![0.0; width * height * 3], photo }
    }

    fn geometry(count: usize, pose: [f32; 9]) -> FrameGeometry {
        FrameGeometry {
            pose,
            depth: (0..count).map(|i| 1.0 + i as f32 * 0.01).collect(),
            depth_confidence: vec![2.0; count],
            points: Vec::new(),
            point_confidence: Vec::new(),
        }
    }

    const TURNED: [f32; 9] = [0.1, -0.2, 0.3, 0.1, 0.2, -0.1, 0.9, 0.8, 1.1];

    /// A device that has room for so many photos, and counts how often it was asked.
    struct Room {
        name: &'static str,
        photos: usize,
        asked: Mutex<usize>,
    }

    impl Estimate for Room {
        fn device(&self) -> String {
            self.name.into()
        }

        fn run(&self, frames: &[Frame]) -> Result<Vec<FrameGeometry>, NetError> {
            *self.asked.lock().unwrap() += 1;
            if frames.len() > self.photos {
                return Err(NetError::OutOfMemory { device: self.name.into(), needed: 7, free: 5 });
            }
            Ok(frames.iter().map(|_| geometry(4, [0.0; 9])).collect())
        }
    }

    #[test]
    fn too_little_memory_while_running_means_the_other_device_from_then_on() {
        let room = |name, photos| Arc::new(Room { name, photos, asked: Mutex::default() });
        let (gpu, cpu) = (room("gpu", 1), room("cpu", 9));
        let plain = VggtEstimator { network: gpu.clone(), model: String::new(), patch: 14, note: None };
        let other: Arc<dyn Estimate> = cpu.clone();
        let either = plain.or_cpu(move || Ok(Arc::clone(&other)));
        let frames = |n| vec![frame(2, 2, [0, 0, 2, 2]); n];
        assert_eq!(either.network.run(&frames(1)).unwrap().len(), 1);
        assert_eq!((either.device().as_str(), *cpu.asked.lock().unwrap()), ("gpu", 0));
        assert_eq!(either.network.run(&frames(2)).unwrap().len(), 2);
        assert!(either.device().starts_with("cpu; no longer on a GPU: gpu has too little memory: 7 bytes"));
        assert_eq!(either.network.run(&frames(1)).unwrap().len(), 1);
        assert_eq!((*gpu.asked.lock().unwrap(), *cpu.asked.lock().unwrap()), (2, 2));
    }

    #[test]
    fn half_a_pixel_lies_between_their_indices_and_our_centres() {
        // Their formula, written out: Xc = ((u - W/2) d / fx, (v - H/2) d / fy, d) with integer u, v; Xw = R^T (Xc - t).
        let (w, h) = (28usize, 14usize);
        let answer = geometry(w * h, TURNED);
        let map = point_map(&frame(w, h, [0, 0, w, h]), &answer).unwrap();
        let fx = (w as f64 / 2.0) / (f64::from(TURNED[8]) / 2.0).tan();
        let fy = (h as f64 / 2.0) / (f64::from(TURNED[7]) / 2.0).tan();
        for v in 0..h {
            for u in 0..w {
                let d = f64::from(answer.depth[v * w + u]);
                let theirs = DVec3::new((u as f64 - w as f64 / 2.0) * d / fx, (v as f64 - h as f64 / 2.0) * d / fy, d);
                // Our reading of the finished map: its own camera sees the point at the centre of its pixel.
                let p = map.xyz[v * w + u].as_dvec3();
                let seen = map.rotation * p + map.translation;
                assert!((seen - theirs).length() <= 1e-5, "{u} {v}: {seen} {theirs}");
                let k = map.intrinsics;
                let pixel = DVec2::new(k.fx * seen.x / seen.z + k.cx, k.fy * seen.y / seen.z + k.cy);
                assert!((pixel - DVec2::new(u as f64 + 0.5, v as f64 + 0.5)).length() <= 1e-4, "{pixel}");
            }
        }
    }

    #[test]
    fn padding_is_cut_away_and_the_rays_stay() {
        let (w, h) = (28usize, 28usize);
        let answer = geometry(w * h, TURNED);
        let whole = point_map(&frame(w, h, [0, 0, w, h]), &answer).unwrap();
        let part = point_map(&frame(w, h, [7, 0, 14, 28]), &answer).unwrap();
        assert_eq!(part.size, ImageSize::new(14, 28));
        for y in 0..28 {
            for x in 0..14 {
                let (a, b) = (whole.xyz[y * 28 + 7 + x], part.xyz[y * 14 + x]);
                assert!((a - b).length() <= 1e-5);
            }
        }
    }

    #[test]
    fn nonsense_is_refused_in_words() {
        let f = frame(28, 14, [0, 0, 28, 14]);
        let with = |i: usize, v: f32| {
            let mut pose = TURNED;
            pose[i] = v;
            point_map(&f, &geometry(28 * 14, pose))
        };
        assert!(with(0, f32::NAN).unwrap_err().contains("finite"));
        assert!(with(7, 0.0).unwrap_err().contains("field of view"));
        assert!(with(8, 3.2).unwrap_err().contains("field of view"));
        // Narrow across and wide upwards: found with random weights, which the call book could not record.
        let mut odd = TURNED;
        (odd[7], odd[8]) = (1.2, 0.28);
        let square = frame(28, 28, [0, 0, 28, 28]);
        assert!(point_map(&square, &geometry(28 * 28, odd)).unwrap_err().contains("fields of view"));
        let mut zero = geometry(28 * 14, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.8, 1.1]);
        assert!(point_map(&f, &zero).unwrap_err().contains("direction"));
        zero.pose = TURNED;
        zero.depth.fill(f32::INFINITY);
        assert!(point_map(&f, &zero).unwrap_err().contains("pixels"));
    }
}
