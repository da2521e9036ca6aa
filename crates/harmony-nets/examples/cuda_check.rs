//! The CUDA backend against the reference backend, and VGGT on it: correctness, time and memory. See
//! `docs/performance.md`.
//!
//!     cuda_check ops                            every operation on random inputs, f32, bf16 and f32 multiplied as TF32
//!     cuda_check vggt WEIGHTS EXPECTED          every output of VGGT against the reference's, f32 and bf16
//!     cuda_check time WEIGHTS EXPECTED COUNT..  VGGT on so many photos, eager and recorded, with memory
//!     cuda_check profile WEIGHTS EXPECTED COUNT  kernels of one pass on so many photos, the longest first
//!     cuda_check first WEIGHTS EXPECTED         from the start of the program to the first result

#![expect(clippy::print_stdout, reason = "a program")]

use std::path::Path;
use std::time::Instant;

use harmony_nets::backend::{
    Act, AttentionSpec, Binary, ConvWeights, LinearWeights, Pool, QkNorm, Qkv, Reduce, Resize, Rope2d, TensorHandle,
    Window,
};
use harmony_nets::cpu::Cpu;
use harmony_nets::cuda::Cuda;
use harmony_nets::reference::Reference;
use harmony_nets::vggt::{Frame, FrameGeometry, Heads, Vggt};
use harmony_nets::{Backend, DType, HostTensor, NetError, WeightFile};

type Outcome<T = ()> = Result<T, Box<dyn std::error::Error>>;

const ALL: Heads = Heads { depth: true, points: true };

fn main() -> Outcome {
    let start = Instant::now();
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let (mode, rest) = words.split_first().ok_or("cuda_check ops|vggt|time|profile|first ..")?;
    let cuda = Cuda::open(0)?;
    println!("{}, ready after {:.2} s", cuda.device(), start.elapsed().as_secs_f64());
    match (*mode, rest) {
        ("ops", []) => operations(&cuda),
        ("vggt", [weights, expected]) => parity(&cuda, Path::new(weights), Path::new(expected)),
        ("time", [weights, expected, counts @ ..]) => times(&cuda, Path::new(weights), Path::new(expected), counts),
        ("profile", [weights, expected, count]) => {
            profile(&cuda, Path::new(weights), Path::new(expected), count.parse()?)
        }
        ("first", [weights, expected]) => {
            let frames = frames(&WeightFile::open(Path::new(expected))?)?;
            let file = WeightFile::open(Path::new(weights))?;
            let network = Vggt::load_with(&cuda, &file.at(""), DType::BF16)?;
            println!("loaded after {:.2} s", start.elapsed().as_secs_f64());
            network.run(&cuda, &frames, ALL)?;
            println!("first result after {:.2} s", start.elapsed().as_secs_f64());
            Ok(())
        }
        _ => Err("cuda_check ops|vggt|time|profile|first ..".into()),
    }
}

// ---- operations

/// Random values in about -2..2, always the same.
struct Random(u64);

impl Random {
    fn tensor(&mut self, shape: &[usize]) -> HostTensor {
        let n = shape.iter().product();
        let mut next = || {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 40) as f32 / (1u64 << 24) as f32
        };
        HostTensor::from_f32(shape, (0..n).map(|_| (next() + next() + next() - 1.5) * 1.4).collect())
    }
}

/// Relative L2 error; infinite for NaN or another number of values.
fn error(wanted: &[f32], found: &[f32]) -> f64 {
    if wanted.len() != found.len() {
        return f64::INFINITY;
    }
    let norm = |v: &mut dyn Iterator<Item = f64>| v.map(|x| x * x).sum::<f64>().sqrt();
    let difference = norm(&mut wanted.iter().zip(found).map(|(a, b)| f64::from(a - b)));
    let relative = difference / norm(&mut wanted.iter().map(|v| f64::from(*v))).max(1e-6);
    if relative.is_nan() { f64::INFINITY } else { relative }
}

struct Tally {
    good: bool,
    worst: [(f64, String); 3],
}

impl Tally {
    fn add(&mut self, name: &str, which: usize, outcome: Result<f64, NetError>) {
        // Beside bf16, f32 is multiplied as TF32 and large attention in bf16.
        let limit = [1e-5, 2e-2, 5e-3][which];
        let kind = ["f32", "bf16", "tf32"][which];
        match outcome {
            Ok(e) => {
                if e > limit {
                    self.good = false;
                    println!("WRONG {kind} {name}: {e:.2e}");
                }
                if e > self.worst[which].0 {
                    self.worst[which] = (e, name.into());
                }
            }
            Err(e) => {
                self.good = false;
                println!("FAILED {kind} {name}: {e}");
            }
        }
    }
}

macro_rules! both {
    ($tally:expr, $cuda:expr, $name:expr, |$b:ident, $t:ident| $body:expr) => {
        against!(&Reference, $tally, $cuda, $name, |$b, $t| $body)
    };
}

macro_rules! against {
    ($oracle:expr, $tally:expr, $cuda:expr, $name:expr, |$b:ident, $t:ident| $body:expr) => {{
        let wanted = {
            let ($b, $t) = ($oracle, DType::F32);
            let y = $body?;
            (y.shape().to_vec(), $b.read(&y)?)
        };
        let exact = $cuda.without_tf32();
        let kinds = [(&exact, DType::F32), ($cuda, DType::BF16), ($cuda, DType::F32)];
        for (which, ($b, $t)) in kinds.into_iter().enumerate() {
            let outcome = (|| {
                let y = $body?;
                let values = $b.read(&y)?;
                Ok(if y.shape() == wanted.0 { error(&wanted.1, &values) } else { f64::INFINITY })
            })();
            $tally.add(&$name, which, outcome);
        }
    }};
}

fn operations(cuda: &Cuda) -> Outcome {
    let mut r = Random(1);
    let none = || (0.0, String::from("none"));
    let mut tally = Tally { good: true, worst: [none(), none(), none()] };
    let acts = [Act::None, Act::Relu, Act::Gelu, Act::GeluTanh, Act::QuickGelu, Act::Silu, Act::Sigmoid];
    for (m, k, n) in [(1, 3, 5), (7, 64, 33), (13, 300, 72), (50, 513, 1100), (130, 256, 31), (300, 40, 40), (9, 9, 64)]
    {
        let (x, residual) = (r.tensor(&[m, k]), r.tensor(&[m, n]));
        let (weight, bias, scale) = (r.tensor(&[n, k]), r.tensor(&[n]), r.tensor(&[n]));
        for (act, with) in acts.into_iter().flat_map(|a| [(a, false), (a, true)]) {
            let scale = (act == Act::None && with).then(|| scale.clone());
            let weights = LinearWeights { weight: weight.clone(), bias: with.then(|| bias.clone()), scale };
            both!(tally, cuda, format!("linear {m} {k} {n} {act:?} {with}"), |b, t| {
                let w = b.load_linear(&weights, t)?;
                let residual = with.then(|| b.load(&residual, t)).transpose()?;
                b.linear(&b.load(&x, t)?, &w, act, residual)
            });
        }
        let weights = LinearWeights { weight: weight.clone(), bias: Some(bias.clone()), scale: None };
        both!(tally, cuda, format!("linear {m} {k} {n} gelu with bias alone"), |b, t| {
            b.linear(&b.load(&x, t)?, &b.load_linear(&weights, t)?, Act::Gelu, None)
        });
    }
    for transposed in [false, true] {
        for (a, front) in [(vec![3, 17, 40], vec![3]), (vec![2, 3, 9, 70], vec![])] {
            let (k, n) = (a[a.len() - 1], 45);
            let shape = [front.clone(), if transposed { vec![n, k] } else { vec![k, n] }].concat();
            let (a, m) = (r.tensor(&a), r.tensor(&shape));
            both!(tally, cuda, format!("matmul {transposed}"), |b, t| b.matmul(
                &b.load(&a, t)?,
                &b.load(&m, t)?,
                transposed
            ));
        }
    }
    for c in [1, 8, 64, 100, 1024, 1152, 2048, 4096, 4100] {
        let (x, w, v) = (r.tensor(&[5, 3, c]), r.tensor(&[c]), r.tensor(&[c]));
        if c > 1 {
            both!(tally, cuda, format!("layer_norm {c}"), |b, t| {
                let (w, v) = (b.load(&w, DType::F32)?, b.load(&v, DType::F32)?);
                b.layer_norm(&b.load(&x, t)?, Some(&w), Some(&v), 1e-5)
            });
            both!(tally, cuda, format!("layer_norm plain {c}"), |b, t| b.layer_norm(&b.load(&x, t)?, None, None, 1e-6));
        }
        both!(tally, cuda, format!("softmax {c}"), |b, t| b.softmax(&b.load(&x, t)?));
        both!(tally, cuda, format!("l2 {c}"), |b, t| b.l2_normalize(&b.load(&x, t)?, 1e-6));
        for how in [Reduce::Mean, Reduce::Max] {
            both!(tally, cuda, format!("reduce {how:?} {c}"), |b, t| b.reduce(&b.load(&x, t)?, how));
        }
        for op in [Binary::Add, Binary::Sub, Binary::Mul, Binary::Div] {
            // Away from zero, where a quotient would magnify the rounding of its divisor.
            let v = HostTensor::from_f32(&[c], v.to_f32().iter().map(|v| 3.0 + v.abs()).collect());
            both!(tally, cuda, format!("binary {op:?} {c}"), |b, t| b.binary(b.load(&x, t)?, &b.load(&v, t)?, op));
        }
        both!(tally, cuda, format!("affine {c}"), |b, t| b.affine(&b.load(&x, t)?, 0.5, -3.0));
        for act in [Act::Gelu, Act::Exp, Act::Silu] {
            both!(tally, cuda, format!("activation {act:?} {c}"), |b, t| b.activation(&b.load(&x, t)?, act));
        }
    }
    for (batch, n, heads, dim) in [
        (1, 1, 2, 8),
        (2, 50, 3, 16),
        (1, 131, 2, 64),
        (1, 700, 1, 32),
        (2, 65, 2, 72),
        (1, 200, 2, 128),
        (1, 70, 1, 144),
    ] {
        let qkv = r.tensor(&[batch, n, 3 * heads * dim]);
        let norm: Vec<_> = (0..4).map(|_| r.tensor(&[dim])).collect();
        let (cos, sin, bias) = (r.tensor(&[n, dim / 2]), r.tensor(&[n, dim / 2]), r.tensor(&[1, n, n]));
        for kind in 0..4 {
            both!(tally, cuda, format!("attention {batch} {n} {heads} {dim} kind {kind}"), |b, t| {
                let full = |h: &HostTensor| b.load(h, DType::F32);
                let norm = [full(&norm[0])?, full(&norm[1])?, full(&norm[2])?, full(&norm[3])?];
                let (cos, sin, bias) = (full(&cos)?, full(&sin)?, full(&bias)?);
                let mut spec = AttentionSpec::heads(heads);
                if kind == 1 {
                    let [q_weight, q_bias, k_weight, k_bias] = &norm;
                    spec.qk_norm = Some(QkNorm { q_weight, q_bias, k_weight, k_bias, eps: 1e-5 });
                    spec.rope = Some(Rope2d { cos: &cos, sin: &sin });
                    // Random "cosines" make large scores; a softmax that is all but a maximum magnifies any rounding.
                    spec.scale = Some(0.1 / (dim as f32).sqrt());
                }
                spec.causal = kind == 2;
                spec.bias = (kind == 3).then_some(&bias);
                b.attention(Qkv::Packed(&b.load(&qkv, t)?), &spec)
            });
        }
    }
    let (q, k, v) = (r.tensor(&[2, 5, 32]), r.tensor(&[2, 70, 32]), r.tensor(&[2, 70, 48]));
    // The second batch sees nothing at all.
    let hidden = (0..140).map(|i| if i < 60 { 0.0 } else { f32::NEG_INFINITY }).collect();
    let bias = HostTensor::from_f32(&[2, 1, 70], hidden);
    for (name, v) in [("wider values", &v), ("same sizes", &k)] {
        both!(tally, cuda, format!("cross attention, hidden keys, {name}"), |b, t| {
            let (q, k, v, bias) = (b.load(&q, t)?, b.load(&k, t)?, b.load(v, t)?, b.load(&bias, DType::F32)?);
            let spec = AttentionSpec { bias: Some(&bias), ..AttentionSpec::heads(2) };
            b.attention(Qkv::Separate { q: &q, k: &k, v: &v }, &spec)
        });
    }
    for (c, o, k, stride, padding) in [
        (3, 8, 7, 4, 3),
        (3, 40, 14, 14, 0),
        (20, 33, 3, 1, 1),
        (16, 16, 3, 2, 1),
        (64, 32, 3, 1, 1),
        (300, 12, 1, 1, 0),
        (5, 6, 2, 2, 0),
    ] {
        let x = r.tensor(&[2, 28, 29, c]);
        let weights = ConvWeights { weight: r.tensor(&[o, c, k, k]), bias: Some(r.tensor(&[o])) };
        both!(tally, cuda, format!("conv {c} {o} {k}"), |b, t| {
            let w = b.load_conv(&weights, Window::conv(stride, padding), t)?;
            b.conv2d(&b.load(&x, t)?, &w, Act::Relu, None)
        });
        let plain = ConvWeights { bias: None, ..weights.clone() };
        both!(tally, cuda, format!("conv with residual {c} {o} {k}"), |b, t| {
            let w = b.load_conv(&plain, Window::conv(stride, padding), t)?;
            let y = b.conv2d(&b.load(&x, t)?, &w, Act::Gelu, None)?;
            b.conv2d(&b.load(&x, t)?, &w, Act::None, Some(y))
        });
        let weights = ConvWeights { weight: r.tensor(&[c, o, 2, 2]), bias: Some(r.tensor(&[o])) };
        let residual = r.tensor(&[2, 56, 58, o]);
        both!(tally, cuda, format!("transposed conv {c} {o}"), |b, t| {
            let w = b.load_conv_transpose(&weights, t)?;
            b.conv_transpose2d(&b.load(&x, t)?, &w, Act::Gelu, Some(b.load(&residual, t)?))
        });
    }
    for c in [5, 16] {
        let x = r.tensor(&[2, 13, 9, c]);
        for how in [Resize::Nearest, Resize::Bilinear, Resize::BilinearCorners, Resize::Bicubic] {
            for (h, w) in [(13, 9), (26, 18), (7, 20), (1, 1)] {
                both!(tally, cuda, format!("resize {how:?} {h} {w} {c}"), |b, t| b.resize(&b.load(&x, t)?, h, w, how));
            }
        }
        for kind in [Pool::Max, Pool::Mean] {
            let window = Window { size: 3, stride: 2, padding: 1 };
            both!(tally, cuda, format!("pool {kind:?} {c}"), |b, t| b.pool2d(&b.load(&x, t)?, kind, window));
        }
        both!(tally, cuda, format!("windows {c}"), |b, t| b.window_partition(&b.load(&x, t)?, 4));
        both!(tally, cuda, format!("windows and back {c}"), |b, t| {
            b.window_merge(&b.window_partition(&b.load(&x, t)?, 4)?, 4, 13, 9)
        });
        both!(tally, cuda, format!("permute {c}"), |b, t| b.permute(&b.load(&x, t)?, &[3, 0, 2, 1]));
        for axis in 0..4 {
            both!(tally, cuda, format!("slice and concat {axis} {c}"), |b, t| {
                let x = b.load(&x, t)?;
                let n = x.dim(axis);
                let (front, back) = (b.slice(&x, axis, 0, n / 2)?, b.slice(&x, axis, n / 2, n - n / 2)?);
                b.concat(&[&back, &front], axis)
            });
        }
        both!(tally, cuda, format!("gather {c}"), |b, t| {
            let table = b.reshape(&b.load(&x, t)?, &[2 * 13 * 9, c])?;
            b.gather_rows(&table, &(0..600).map(|i| i * 7 % 234).collect::<Vec<_>>())
        });
    }
    recording(&cuda.without_tf32(), &mut tally)?;
    let wrong = cuda.slice(&cuda.load(&r.tensor(&[2, 3]), DType::F32)?, 1, 2, 2);
    tally.good &= matches!(wrong, Err(NetError::Shape { .. }));
    large(cuda, &mut r, &mut tally)?;
    for (kind, (e, name)) in ["f32", "bf16", "tf32"].iter().zip(&tally.worst) {
        println!("worst {kind}: {e:.2e} ({name})");
    }
    if tally.good { Ok(()) } else { Err("an operation is wrong".into()) }
}

/// A chain recorded on its second run gives the right answer for new inputs in later ones.
fn recording(cuda: &Cuda, tally: &mut Tally) -> Outcome {
    let mut r = Random(77);
    let weights = LinearWeights { weight: r.tensor(&[64, 64]), bias: Some(r.tensor(&[64])), scale: None };
    let (w, reference) = (cuda.load_linear(&weights, DType::F32)?, Reference.load_linear(&weights, DType::F32)?);
    for round in 0..4 {
        let x = r.tensor(&[20, 64]);
        let mut inner = Reference.load(&x, DType::F32)?;
        for _ in 0..3 {
            inner = Reference.linear(&inner, &reference, Act::Gelu, Some(inner.clone()))?;
            inner = Reference.layer_norm(&inner, None, None, 1e-5)?;
        }
        let found = cuda.replayable("check", &[&cuda.load(&x, DType::F32)?], &mut |inputs| {
            let mut x = inputs[0].clone();
            for _ in 0..3 {
                x = cuda.linear(&x, &w, Act::Gelu, Some(x.clone()))?;
                x = cuda.layer_norm(&x, None, None, 1e-5)?;
            }
            Ok(vec![x])
        })?;
        let e = error(&Reference.read(&inner)?, &cuda.read(&found[0])?);
        tally.add(&format!("recording, round {round}"), 0, Ok(e));
    }
    Ok(())
}

/// Sizes for which the GPU has kernels of their own; the quick CPU backend is the oracle.
fn large(cuda: &Cuda, r: &mut Random, tally: &mut Tally) -> Outcome {
    let oracle = Cpu::new();
    for (n, h, w, c, o, k, stride, padding) in [
        (1, 131, 128, 64, 256, 3, 1, 1),
        (2, 97, 131, 128, 300, 3, 1, 1),
        (1, 131, 128, 128, 128, 3, 1, 1),
        (3, 90, 91, 64, 32, 3, 1, 1),
        (1, 19, 14, 256, 256, 3, 1, 1),
        (2, 28, 37, 192, 194, 3, 2, 1),
        (1, 200, 201, 64, 140, 2, 2, 0),
    ] {
        let x = r.tensor(&[n, h, w, c]);
        let weights = ConvWeights { weight: r.tensor(&[o, c, k, k]), bias: Some(r.tensor(&[o])) };
        against!(&oracle, tally, cuda, format!("large conv {n}x{h}x{w} {c} {o} {k}"), |b, t| {
            let w = b.load_conv(&weights, Window::conv(stride, padding), t)?;
            let x = b.load(&x, t)?;
            let y = b.conv2d(&x, &w, Act::Relu, None)?;
            b.conv2d(&x, &w, Act::None, Some(y))
        });
    }
    for (batch, n, heads) in [(5, 700, 16), (1, 2111, 24), (40, 65, 8), (3, 128, 100), (2, 1041, 16)] {
        let qkv = r.tensor(&[batch, n, 3 * heads * 64]);
        against!(&oracle, tally, cuda, format!("large attention {batch} {n} {heads}"), |b, t| {
            b.attention(Qkv::Packed(&b.load(&qkv, t)?), &AttentionSpec::heads(heads))
        });
    }
    let (q, k, v) = (r.tensor(&[7, 900, 512]), r.tensor(&[7, 333, 512]), r.tensor(&[7, 333, 512]));
    against!(&oracle, tally, cuda, "large cross attention", |b, t| {
        let (q, k, v) = (b.load(&q, t)?, b.load(&k, t)?, b.load(&v, t)?);
        b.attention(Qkv::Separate { q: &q, k: &k, v: &v }, &AttentionSpec::heads(8))
    });
    Ok(())
}

fn profile(cuda: &Cuda, weights: &Path, expected: &Path, count: usize) -> Outcome {
    let photo = frames(&WeightFile::open(expected)?)?.into_iter().next().ok_or("no photo")?;
    let file = WeightFile::open(weights)?;
    let frames = vec![photo; count];
    let network = Vggt::load_with(cuda, &file.at(""), DType::F32)?;
    network.timed(cuda, &frames, ALL, false)?;
    let (_, kernels) = cuda.profiled(|| network.timed(cuda, &frames, ALL, false))?;
    println!("{count} photos, {:.2} ms in kernels:", kernels.iter().map(|k| k.1 as f64 * k.2).sum::<f64>());
    for (name, launches, ms) in kernels.iter().take(30) {
        println!("{:9.3} ms = {launches:5} x {ms:7.4}  {name}", *launches as f64 * ms);
    }
    Ok(())
}

// ---- VGGT

fn frames(expected: &WeightFile) -> Outcome<Vec<Frame>> {
    let images = expected.find("full.images").ok_or("no images among the expected arrays")?;
    let [_, height, width, _] = *images.shape() else { return Err("images have four axes".into()) };
    let one = |rgb: &[f32]| Frame { width, height, rgb: rgb.to_vec(), photo: [0, 0, width, height] };
    Ok(images.to_f32().chunks_exact(height * width * 3).map(one).collect())
}

fn outputs(found: &[FrameGeometry]) -> [(&'static str, Vec<f32>); 5] {
    let join = |f: &dyn Fn(&FrameGeometry) -> Vec<f32>| found.iter().flat_map(f).collect::<Vec<f32>>();
    [
        ("pose_enc", join(&|f| f.pose.to_vec())),
        ("depth", join(&|f| f.depth.clone())),
        ("depth_conf", join(&|f| f.depth_confidence.clone())),
        ("world_points", join(&|f| f.points.concat())),
        ("world_points_conf", join(&|f| f.point_confidence.clone())),
    ]
}

/// Trunk type, head type, name.
const KINDS: [(DType, DType, &str); 3] = [
    (DType::F32, DType::F32, "f32"),
    (DType::BF16, DType::F32, "bf16, heads tf32"),
    (DType::BF16, DType::BF16, "bf16, heads bf16"),
];

fn parity(cuda: &Cuda, weights: &Path, expected: &Path) -> Outcome {
    let expected = WeightFile::open(expected)?;
    let frames = frames(&expected)?;
    let file = WeightFile::open(weights)?;
    let mut good = true;
    for (trunk, heads, name) in KINDS {
        let cuda = cuda.computing_in(trunk);
        let network = Vggt::load_with(&cuda, &file.at(""), heads)?;
        // The third run is a replay: it must say what the first said.
        let first = network.run(&cuda, &frames, ALL)?;
        network.run(&cuda, &frames, ALL)?;
        let third = network.run(&cuda, &frames, ALL)?;
        for ((output, values), (_, again)) in outputs(&first).into_iter().zip(outputs(&third)) {
            let wanted = expected.find(&format!("full.{output}")).ok_or("an output is missing")?.to_f32();
            let (l2, replay) = (error(&wanted, &values), error(&values, &again));
            let limit = if trunk == DType::F32 { 1e-4 } else { 2e-2 };
            good &= l2 <= limit && replay <= limit;
            println!("| {name} | {output} | {} | {l2:.1e} | {replay:.1e} |", values.len());
        }
        drop(network);
        cuda.trim();
    }
    if good { Ok(()) } else { Err("an output is too far off".into()) }
}

fn times(cuda: &Cuda, weights: &Path, expected: &Path, counts: &[&str]) -> Outcome {
    let photo = frames(&WeightFile::open(expected)?)?.into_iter().next().ok_or("no photo")?;
    let file = WeightFile::open(weights)?;
    for (trunk, heads, name) in &KINDS[1..] {
        let cuda = cuda.computing_in(*trunk);
        let start = Instant::now();
        let network = Vggt::load_with(&cuda, &file.at(""), *heads)?;
        cuda.synchronize()?;
        let held = cuda.memory().0 >> 20;
        println!("{name}: loaded in {:.2} s, {held} MiB", start.elapsed().as_secs_f64());
        for count in counts {
            let frames = vec![photo.clone(); count.parse()?];
            let rounds = if frames.len() > 8 { 5 } else { 12 };
            let mut whole = Vec::new();
            for _ in 0..rounds {
                let start = Instant::now();
                network.run(&cuda, &frames, ALL)?;
                whole.push(start.elapsed().as_secs_f64() * 1e3);
            }
            let first = whole[0];
            let middle = |v: &mut Vec<f64>| {
                v.sort_by(f64::total_cmp);
                v[v.len() / 2]
            };
            let whole = middle(&mut whole[2..].to_vec());
            // The network alone, as the peer is timed: pixels on the device, outputs left there.
            let (mut eager, mut replayed) = (Vec::new(), Vec::new());
            for round in 0..rounds * 2 {
                let recorded = round >= rounds;
                let ms = network.timed(&cuda, &frames, ALL, recorded)?;
                if recorded { &mut replayed } else { &mut eager }.push(ms);
            }
            let (eager, replayed) = (middle(&mut eager[1..].to_vec()), middle(&mut replayed[2..].to_vec()));
            let peak = cuda.memory().1 >> 20;
            println!(
                "{name}, {count} photos: network eager {eager:.2} ms, replayed {replayed:.2} ms; first run {first:.0} ms, \
                 whole run with copies {whole:.1} ms; memory at most {peak} MiB"
            );
            cuda.trim();
        }
        drop(network);
        cuda.trim();
    }
    Ok(())
}
