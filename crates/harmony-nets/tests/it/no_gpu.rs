//! What is said where there is no GPU to be used.
#![cfg(feature = "cuda")]

use harmony_nets::NetError;
use harmony_nets::cuda::Cuda;

#[test]
fn what_is_missing_for_a_gpu_is_named() {
    match Cuda::open(0) {
        Ok(gpu) => {
            harmony_testing::skip(format_args!("in part: there is a GPU here ({gpu:?})"));
            let Err(NetError::Device { device, reason }) = Cuda::open(4095) else { panic!("GPU number 4095") };
            assert_eq!(device, "cuda");
            assert!(reason.starts_with("no GPU number 4095; the driver sees "), "{reason}");
        }
        Err(NetError::Device { device, reason }) => {
            assert_eq!(device, "cuda");
            // The driver, a library, or the GPU itself; each in words that say what to look for.
            let named = ["libcuda", "libnvrtc", "libcublasLt", "no GPU number", "the driver says"];
            assert!(named.iter().any(|n| reason.contains(n)), "{reason}");
        }
        Err(other) => panic!("another kind of error: {other}"),
    }
}
