//! Numbers of SciPy on point sets that a formula gives, held without Python.
//!

//! Expected values: `bench/metrics_vs_scipy.py --record` with NumPy 2.4.6 and SciPy 1.17.1.

use glam::DVec3;
use harmony_bench::metrics::gen3dsr::{Distances, THRESHOLDS};
use harmony_bench::metrics::icp::IcpOptions;
use harmony_bench::metrics::midi::{MidiOptions, midi_of_points};
use harmony_bench::metrics::two_way::two_way;

/// Sums over 3000 values in another order.
const TOLERANCE: f64 = 1e-12;

fn lattice(count: u32, steps: [u32; 3], sides: [u32; 3]) -> Vec<DVec3> {
    let point = |i: u32| DVec3::from_array([0, 1, 2].map(|axis| f64::from(i * steps[axis] % sides[axis]) / 64.0));
    (0..count).map(point).collect()
}

fn sets() -> (Vec<DVec3>, Vec<DVec3>) {
    let truth = lattice(3000, [37, 53, 29], [101, 67, 43]);
    let mut prediction = lattice(2000, [41, 59, 31], [97, 71, 47]);
    for p in &mut prediction {
        *p += DVec3::new(0.125, 0.007_812_5, 0.0);
    }
    prediction[7] = DVec3::new(40.0, -3.0, 9.0);
    (prediction, truth)
}

fn assert_close(name: &str, ours: f64, expected: f64) {
    assert!((ours - expected).abs() <= TOLERANCE, "{name}: {ours} instead of {expected}");
}

#[test]
fn chamfer_precision_recall_and_f1_are_those_of_scipy() {
    let (prediction, truth) = sets();
    let ours = Distances::of(&two_way(&prediction, &truth).unwrap(), &THRESHOLDS);
    assert_close("chamfer", ours.chamfer, 0.066_679_791_500_245_04);
    let expected = [
        [81.899_999_999_999_99, 95.133_333_333_333_34, 88.022_066_910_061_77],
        [1.85, 1.233_333_333_333_333_4, 1.479_999_520_000_155_9],
        [0.0, 0.0, 0.0],
    ];
    for (at, expected) in ours.at.iter().zip(expected) {
        assert_close("precision", at.precision, expected[0]);
        assert_close("recall", at.recall, expected[1]);
        assert_close("f1", at.f1, expected[2]);
    }
}

#[test]
fn the_midi_numbers_before_icp_are_those_of_scipy() {
    let (prediction, truth) = sets();
    let icp = IcpOptions { max_iterations: 0, tolerance: 0.0 };
    let ours = midi_of_points(&prediction, &truth, &MidiOptions { icp, ..MidiOptions::default() }).unwrap();
    assert_eq!(ours.score, ours.before_icp, "without a round of ICP");
    let at = ours.before_icp.f_score;
    for (name, ours, expected) in [
        ("chamfer", ours.before_icp.chamfer, 1.289_430_416_666_666_4),
        ("precision", at.precision, 0.648),
        ("recall", at.recall, 0.908),
        ("f1", at.f1, 0.756_277_630_101_043_5),
    ] {
        assert_close(name, ours, expected);
    }
}
