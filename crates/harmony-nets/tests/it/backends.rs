//! The quick CPU backend against the reference, on random inputs of awkward sizes.

#![cfg(feature = "cpu")]

use harmony_nets::backend::{
    Act, AttentionSpec, Binary, ConvWeights, LinearWeights, Pool, QkNorm, Qkv, Reduce, Resize, Rope2d, TensorHandle,
    Window,
};
use harmony_nets::cpu::Cpu;
use harmony_nets::reference::Reference;
use harmony_nets::{Backend, DType, HostTensor};

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

/// Runs the same thing on both backends; relative L2 error and shapes must agree.
fn agree(name: &str, limit: f64, run: impl Fn(&dyn Fn(&str)) -> (Vec<usize>, Vec<f32>, Vec<usize>, Vec<f32>)) {
    let (shape, wanted, found_shape, found) = run(&|_| {});
    assert_eq!(shape, found_shape, "{name}");
    let square = |v: &mut dyn Iterator<Item = f64>| v.map(|x| x * x).sum::<f64>().sqrt();
    let error = square(&mut wanted.iter().zip(&found).map(|(a, b)| f64::from(a - b)));
    let size = square(&mut wanted.iter().map(|v| f64::from(*v)));
    assert!(error <= limit * size.max(1e-6), "{name}: relative error {}", error / size);
}

macro_rules! both {
    ($name:expr, |$b:ident| $body:expr) => {
        agree($name, 2e-6, |_| {
            let $b = Reference;
            let wanted = $body.unwrap();
            let wanted = (wanted.shape().to_vec(), $b.read(&wanted).unwrap());
            let $b = Cpu::new();
            let found = $body.unwrap();
            let found = (found.shape().to_vec(), $b.read(&found).unwrap());
            (wanted.0, wanted.1, found.0, found.1)
        })
    };
}

const F32: DType = DType::F32;

#[test]
fn linear_layers_agree() {
    let mut r = Random(1);
    for (m, k, n) in [(1, 3, 5), (7, 64, 33), (13, 300, 70), (50, 513, 1100), (130, 257, 31), (1300, 40, 40)] {
        let x = r.tensor(&[m, k]);
        let weights =
            LinearWeights { weight: r.tensor(&[n, k]), bias: Some(r.tensor(&[n])), scale: Some(r.tensor(&[n])) };
        let residual = r.tensor(&[m, n]);
        for act in [Act::None, Act::Relu, Act::Gelu, Act::GeluTanh, Act::QuickGelu, Act::Silu, Act::Sigmoid] {
            both!(&format!("linear {m} {k} {n} {act:?}"), |b| {
                let w = b.load_linear(&weights, F32).unwrap();
                let residual = b.load(&residual, F32).unwrap();
                b.linear(&b.load(&x, F32).unwrap(), &w, act, Some(residual))
            });
        }
    }
}

#[test]
fn products_agree() {
    let mut r = Random(2);
    for transposed in [false, true] {
        for (a, b_front) in [(vec![3, 17, 40], vec![3]), (vec![2, 3, 9, 70], vec![])] {
            let (k, n) = (*a.last().unwrap(), 45);
            let mut shape = b_front.clone();
            shape.extend(if transposed { [n, k] } else { [k, n] });
            let (a, m) = (r.tensor(&a), r.tensor(&shape));
            both!("matmul", |b| b.matmul(&b.load(&a, F32).unwrap(), &b.load(&m, F32).unwrap(), transposed));
        }
    }
}

#[test]
fn norms_and_sums_agree() {
    let mut r = Random(3);
    for c in [1, 8, 64, 100, 1024] {
        let (x, w, v) = (r.tensor(&[5, 3, c]), r.tensor(&[c]), r.tensor(&[c]));
        if c > 1 {
            both!("layer_norm", |b| {
                let (w, v) = (b.load(&w, F32).unwrap(), b.load(&v, F32).unwrap());
                b.layer_norm(&b.load(&x, F32).unwrap(), Some(&w), Some(&v), 1e-5)
            });
        }
        both!("softmax", |b| b.softmax(&b.load(&x, F32).unwrap()));
        both!("l2", |b| b.l2_normalize(&b.load(&x, F32).unwrap(), 1e-6));
        for how in [Reduce::Sum, Reduce::Mean, Reduce::Max] {
            both!("reduce", |b| b.reduce(&b.load(&x, F32).unwrap(), how));
        }
        for op in [Binary::Add, Binary::Sub, Binary::Mul, Binary::Div] {
            both!("binary", |b| b.binary(b.load(&x, F32).unwrap(), &b.load(&w, F32).unwrap(), op));
        }
        both!("affine", |b| b.affine(&b.load(&x, F32).unwrap(), 0.5, -3.0));
        for act in [Act::Gelu, Act::Exp, Act::Silu] {
            both!("activation", |b| b.activation(&b.load(&x, F32).unwrap(), act));
        }
    }
}

#[test]
fn attention_agrees() {
    let mut r = Random(4);
    for (batch, n, heads, dim) in [(1, 1, 2, 8), (2, 50, 3, 16), (1, 131, 2, 64), (1, 1600, 1, 32)] {
        let qkv = r.tensor(&[batch, n, 3 * heads * dim]);
        let norm: Vec<_> = (0..4).map(|_| r.tensor(&[dim])).collect();
        let (cos, sin) = (r.tensor(&[n, dim / 2]), r.tensor(&[n, dim / 2]));
        let bias = r.tensor(&[1, n, n]);
        for kind in 0..4 {
            both!(&format!("attention {batch} {n} {heads} {dim} kind {kind}"), |b| {
                let load = |t: &HostTensor| b.load(t, F32).unwrap();
                let (norm, cos, sin, bias): (Vec<_>, _, _, _) =
                    (norm.iter().map(load).collect(), load(&cos), load(&sin), load(&bias));
                let mut spec = AttentionSpec::heads(heads);
                if kind == 1 {
                    let [q_weight, q_bias, k_weight, k_bias] = [&norm[0], &norm[1], &norm[2], &norm[3]];
                    spec.qk_norm = Some(QkNorm { q_weight, q_bias, k_weight, k_bias, eps: 1e-5 });
                    spec.rope = Some(Rope2d { cos: &cos, sin: &sin });
                }
                spec.causal = kind == 2;
                spec.bias = (kind == 3).then_some(&bias);
                b.attention(Qkv::Packed(&load(&qkv)), &spec)
            });
        }
    }
}

#[test]
fn cross_attention_with_hidden_keys_agrees() {
    let mut r = Random(5);
    let (q, k, v) = (r.tensor(&[2, 5, 24]), r.tensor(&[2, 70, 24]), r.tensor(&[2, 70, 40]));
    // The second batch sees nothing at all.
    let hidden: Vec<f32> = (0..140).map(|i| if i < 60 { 0.0 } else { f32::NEG_INFINITY }).collect();
    let bias = HostTensor::from_f32(&[2, 1, 70], hidden);
    both!("cross attention", |b| {
        let load = |t: &HostTensor| b.load(t, F32).unwrap();
        let (q, k, v, bias) = (load(&q), load(&k), load(&v), load(&bias));
        let spec = AttentionSpec { bias: Some(&bias), ..AttentionSpec::heads(2) };
        b.attention(Qkv::Separate { q: &q, k: &k, v: &v }, &spec)
    });
}

#[test]
fn convolutions_agree() {
    let mut r = Random(6);
    for (c, o, k, stride, padding) in
        [(3, 8, 7, 4, 3), (3, 40, 14, 14, 0), (20, 33, 3, 1, 1), (16, 16, 3, 2, 1), (300, 12, 1, 1, 0), (5, 6, 2, 2, 0)]
    {
        let x = r.tensor(&[2, 28, 29, c]);
        let weights = ConvWeights { weight: r.tensor(&[o, c, k, k]), bias: Some(r.tensor(&[o])) };
        both!(&format!("conv {c} {o} {k}"), |b| {
            let w = b.load_conv(&weights, Window::conv(stride, padding), F32).unwrap();
            b.conv2d(&b.load(&x, F32).unwrap(), &w, Act::Relu, None)
        });
        let weights = ConvWeights { weight: r.tensor(&[c, o, 2, 2]), bias: Some(r.tensor(&[o])) };
        let residual = r.tensor(&[2, 56, 58, o]);
        both!("transposed conv", |b| {
            let w = b.load_conv_transpose(&weights, F32).unwrap();
            b.conv_transpose2d(&b.load(&x, F32).unwrap(), &w, Act::Gelu, Some(b.load(&residual, F32).unwrap()))
        });
    }
}

#[test]
fn images_agree() {
    let mut r = Random(7);
    let x = r.tensor(&[2, 13, 9, 5]);
    for how in [Resize::Nearest, Resize::Bilinear, Resize::BilinearCorners, Resize::Bicubic] {
        for (h, w) in [(13, 9), (26, 18), (7, 20), (1, 1)] {
            both!(&format!("resize {how:?} {h} {w}"), |b| b.resize(&b.load(&x, F32).unwrap(), h, w, how));
        }
    }
    for kind in [Pool::Max, Pool::Mean] {
        let window = Window { size: 3, stride: 2, padding: 1 };
        both!("pool", |b| b.pool2d(&b.load(&x, F32).unwrap(), kind, window));
    }
    both!("windows", |b| b.window_partition(&b.load(&x, F32).unwrap(), 4));
    both!("windows and back", |b| {
        let windows = b.window_partition(&b.load(&x, F32).unwrap(), 4).unwrap();
        b.window_merge(&windows, 4, 13, 9)
    });
    both!("permute", |b| b.permute(&b.load(&x, F32).unwrap(), &[3, 0, 2, 1]));
    both!("slice and concat", |b| {
        let x = b.load(&x, F32).unwrap();
        let (front, back) = (b.slice(&x, 1, 0, 4).unwrap(), b.slice(&x, 1, 4, 9).unwrap());
        b.concat(&[&back, &front], 1)
    });
}

#[test]
fn wrong_shapes_are_errors() {
    let b = Cpu::new();
    let x = b.load(&HostTensor::from_f32(&[2, 3], vec![0.0; 6]), F32).unwrap();
    let weights = LinearWeights { weight: HostTensor::from_f32(&[4, 5], vec![0.0; 20]), bias: None, scale: None };
    let w = b.load_linear(&weights, F32).unwrap();
    assert!(b.linear(&x, &w, Act::None, None).is_err());
    assert!(b.reshape(&x, &[7]).is_err());
    assert!(b.matmul(&x, &x, false).is_err());
    assert!(b.attention(Qkv::Packed(&x), &AttentionSpec::heads(1)).is_err());
    assert!(b.resize(&x, 2, 2, Resize::Nearest).is_err());
    assert!(b.slice(&x, 1, 2, 2).is_err());
    assert!(b.gather_rows(&x, &[2]).is_err());
}

/// The tests of this file with the kernels of lesser processors, in processes of their own: the level is chosen once.
#[test]
fn lower_levels_agree() {
    if std::env::var_os("HARMONY_SIMD").is_some() {
        return;
    }
    for level in ["avx2", "portable"] {
        let mut tests = std::process::Command::new(std::env::current_exe().unwrap());
        let run = tests
            .args(["backends::", "--skip", "lower_levels", "--nocapture"])
            .env("HARMONY_SIMD", level)
            .output()
            .unwrap();
        let said = [run.stdout, run.stderr].map(|s| String::from_utf8_lossy(&s).into_owned()).concat();
        assert!(run.status.success(), "{level}: {said}");
        assert!(said.contains("test result: ok.") && !said.contains("ok. 0 passed"), "{level}: {said}");
    }
}

#[test]
fn the_level_asked_for_is_taken() {
    let device = Cpu::new().device();
    match std::env::var("HARMONY_SIMD").as_deref() {
        // What the machine does not have gives way to something lesser still.
        Ok("avx2") => assert!(device.contains("avx2") || device.contains("portable"), "{device}"),
        Ok(level) => assert!(device.contains(level), "{device}"),
        Err(_) => assert!(["avx512", "avx2", "portable"].iter().any(|l| device.contains(l)), "{device}"),
    }
}
