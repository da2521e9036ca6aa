//! LPIPS 0.1: how different two pictures look to a network (Zhang et al. 2018, arXiv 1801.03924).
//!
//! Trunks are torchvision's AlexNet and VGG-16 (only `features.*` of their files is read), heads are the small files of
//! the `lpips` package (`lin{k}.model.1.weight`). Pictures are not resized.

use std::path::Path;
use std::sync::Arc;

use image::RgbImage;

use crate::backend::{Act, Backend, Binary, Pool, Reduce, TensorHandle, Window};
use crate::params::{Params, WeightSource};
use crate::{DType, HostTensor, NetError, WeightFile};

/// Shift and scale of pixels in -1..1, from the package.
const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
const SCALE: [f32; 3] = [0.458, 0.448, 0.450];

/// Added to the length of a pixel's features before dividing by it.
const EPS: f32 = 1e-10;

/// The network that looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum LpipsNet {
    /// The package's default.
    Alex,
    /// VGG-16.
    Vgg,
}

/// One convolution of a trunk.
#[derive(Debug, Clone, Copy)]
struct Layer {
    /// Index in torchvision's `features`.
    index: usize,
    out: usize,
    kernel: usize,
    window: Window,
    pool_before: Option<Window>,
    tap: bool,
}

impl LpipsNet {
    /// `alex` or `vgg`, as the package names them.
    pub fn name(self) -> &'static str {
        match self {
            Self::Alex => "alex",
            Self::Vgg => "vgg",
        }
    }

    /// Least side of a picture in pixels: below, a pooling has nothing left.
    pub fn least_side(self) -> u32 {
        match self {
            Self::Alex => 31,
            Self::Vgg => 16,
        }
    }

    fn layers(self) -> Vec<Layer> {
        let pool = |size| Some(Window { size, stride: 2, padding: 0 });
        match self {
            Self::Alex => {
                let layer = |index, out, kernel, window, pool_before| Layer {
                    index,
                    out,
                    kernel,
                    window,
                    pool_before,
                    tap: true,
                };
                vec![
                    layer(0, 64, 11, Window::conv(4, 2), None),
                    layer(3, 192, 5, Window::conv(1, 2), pool(3)),
                    layer(6, 384, 3, Window::conv(1, 1), pool(3)),
                    layer(8, 256, 3, Window::conv(1, 1), None),
                    layer(10, 256, 3, Window::conv(1, 1), None),
                ]
            }
            Self::Vgg => {
                let groups: [&[usize]; 5] = [&[0, 2], &[5, 7], &[10, 12, 14], &[17, 19, 21], &[24, 26, 28]];
                let channels = [64, 128, 256, 512, 512];
                let group = |(g, (indices, out)): (usize, (&[usize], usize))| {
                    let last = indices.len() - 1;
                    let layer = move |(i, index): (usize, &usize)| Layer {
                        index: *index,
                        out,
                        kernel: 3,
                        window: Window::conv(1, 1),
                        pool_before: if i == 0 && g > 0 { pool(2) } else { None },
                        tap: i == last,
                    };
                    indices.iter().enumerate().map(layer).collect::<Vec<_>>()
                };
                groups.into_iter().zip(channels).enumerate().flat_map(group).collect()
            }
        }
    }
}

struct Step<B: Backend> {
    conv: B::Conv,
    pool_before: Option<Window>,
    /// Weights of the head after this step, `[channels, 1]`.
    head: Option<B::Tensor>,
}

/// The metric on a device; computes in f32.
pub struct Lpips<B: Backend> {
    backend: Arc<B>,
    net: LpipsNet,
    steps: Vec<Step<B>>,
}

/// A distance, and what each of the five layers adds to it.
#[derive(Debug, Clone, PartialEq)]
pub struct LpipsDistance {
    /// The sum.
    pub value: f64,
    /// Its parts, shallow first.
    pub layers: Vec<f64>,
}

impl<B: Backend> Lpips<B> {
    /// From the files of torchvision (trunk) and of the `lpips` package (heads).
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn open(trunk: &Path, heads: &Path, net: LpipsNet, backend: Arc<B>) -> Result<Self, NetError> {
        Self::load(backend, &WeightFile::open(trunk)?, &WeightFile::open(heads)?, net)
    }

    /// Puts trunk and heads on the device.
    ///
    /// # Errors
    /// [`NetError::Weights`] for missing keys and wrong shapes, and what the device says.
    pub fn load(
        backend: Arc<B>,
        trunk: &dyn WeightSource,
        heads: &dyn WeightSource,
        net: LpipsNet,
    ) -> Result<Self, NetError> {
        let p = Params::new(&*backend, trunk, DType::F32);
        let heads = Params::new(&*backend, heads, DType::F32);
        let (mut steps, mut input, mut taps) = (Vec::new(), 3, 0);
        for layer in net.layers() {
            let shape = [layer.out, input, layer.kernel, layer.kernel];
            let conv = p.conv(&format!("features.{}", layer.index), shape, layer.window)?;
            let mut head = None;
            if layer.tap {
                let weight = heads.tensor(&format!("lin{taps}.model.1.weight"), &[1, layer.out, 1, 1])?;
                head = Some(backend.reshape(&weight, &[layer.out, 1])?);
                taps += 1;
            }
            steps.push(Step { conv, pool_before: layer.pool_before, head });
            input = layer.out;
        }
        Ok(Self { backend, net, steps })
    }

    /// Distance of two pictures of one size.
    ///
    /// # Errors
    /// [`NetError::Input`] for pictures of two sizes or too small ones, and what the device says.
    pub fn distance(&self, a: &RgbImage, b: &RgbImage) -> Result<LpipsDistance, NetError> {
        let wrong = |reason| Err(NetError::Input { network: "LPIPS", reason });
        if a.dimensions() != b.dimensions() {
            return wrong(format!("pictures of {:?} and {:?} pixels", a.dimensions(), b.dimensions()));
        }
        let least = self.net.least_side();
        if a.width().min(a.height()) < least {
            return wrong(format!("{:?} pixels, {} needs {least} at least", a.dimensions(), self.net.name()));
        }
        let device = &*self.backend;
        let (mut x, mut y) = (self.input(a)?, self.input(b)?);
        let mut layers = Vec::new();
        for step in &self.steps {
            for side in [&mut x, &mut y] {
                if let Some(window) = step.pool_before {
                    *side = device.pool2d(side, Pool::Max, window)?;
                }
                *side = device.conv2d(side, &step.conv, Act::Relu, None)?;
            }
            if let Some(head) = &step.head {
                layers.push(self.compare(&x, &y, head)?);
            }
        }
        Ok(LpipsDistance { value: layers.iter().sum(), layers })
    }

    /// Scaled pixels `[1, height, width, 3]`.
    fn input(&self, photo: &RgbImage) -> Result<B::Tensor, NetError> {
        let scaled = |(i, v): (usize, &u8)| (f32::from(*v) / 255.0 * 2.0 - 1.0 - SHIFT[i % 3]) / SCALE[i % 3];
        let data = photo.as_raw().iter().enumerate().map(scaled).collect();
        let shape = [1, photo.height() as usize, photo.width() as usize, 3];
        self.backend.load(&HostTensor::from_f32(&shape, data), DType::F32)
    }

    /// Weighted squared distance of unit features, mean over the image.
    fn compare(&self, x: &B::Tensor, y: &B::Tensor, head: &B::Tensor) -> Result<f64, NetError> {
        let device = &*self.backend;
        let (pixels, c) = (x.dim(1) * x.dim(2), x.dim(3));
        let unit = |x: &B::Tensor| device.l2_normalize(&device.reshape(x, &[pixels, c])?, EPS);
        let difference = device.binary(unit(x)?, &unit(y)?, Binary::Sub)?;
        let squared = device.binary(difference.clone(), &difference, Binary::Mul)?;
        let weighted = device.reshape(&device.matmul(&squared, head, false)?, &[pixels])?;
        let mean = device.read(&device.reduce(&weighted, Reduce::Mean)?)?;
        Ok(mean.first().copied().map_or(f64::NAN, f64::from))
    }
}
