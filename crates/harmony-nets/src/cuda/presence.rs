//! Whether there is a driver, and one that is new enough; what to do when there is none.

use cudarc::driver::result::{self as driver, DriverError};
use cudarc::driver::sys::{self, CUresult as R};
use cudarc::nvrtc;

use crate::NetError;

/// The oldest driver that has all functions that are called, by its version of CUDA (1000 for each whole number).
const OLDEST: i32 = 12_080;

/// Looks for the driver and the libraries, starts the driver and compares versions.
///
/// # Errors
/// [`NetError::Device`]: what is missing or too old, and what to do.
pub fn check() -> Result<(), NetError> {
    // SAFETY: looking for a library runs its initialisers only, which the vendor's libraries are made for.
    if !unsafe { sys::is_culib_present() } {
        let todo = "with an NVIDIA GPU, install its driver, 580 or newer";
        return Err(absent(format!("no NVIDIA driver on this machine: libcuda was not found; {todo}")));
    }
    driver::init().map_err(first)?;
    let mut version = 0;
    // SAFETY: the driver is there, and writes one number.
    unsafe { sys::cuDriverGetVersion(&raw mut version) }.result().map_err(first)?;
    too_old(version, None).map_or(Ok(()), |reason| Err(absent(reason)))?;
    // SAFETY: as above.
    let libraries = unsafe { [nvrtc::sys::is_culib_present(), cudarc::cublaslt::sys::is_culib_present()] };
    for (there, library) in libraries.into_iter().zip(["libnvrtc", "libcublasLt"]) {
        if !there {
            let hint = "it comes with the CUDA toolkit and with PyTorch; name its folder in LD_LIBRARY_PATH";
            return Err(absent(format!("{library} was not found ({hint})")));
        }
    }
    let (mut major, mut minor) = (0, 0);
    // SAFETY: the compiler is there, and writes two numbers.
    let answer = unsafe { nvrtc::sys::nvrtcVersion(&raw mut major, &raw mut minor) };
    let compiler = (answer == nvrtc::sys::nvrtcResult::NVRTC_SUCCESS).then_some(1000 * major + 10 * minor);
    too_old(version, compiler).map_or(Ok(()), |reason| Err(absent(reason)))
}

pub(super) fn absent(reason: impl Into<String>) -> NetError {
    NetError::Device { device: "cuda".into(), reason: reason.into() }
}

/// The error of a driver that cannot be used from the start.
pub(super) fn first(e: DriverError) -> NetError {
    absent(format!("the driver says: {}{}", words(e), todo(e.0)))
}

pub(super) fn words(e: DriverError) -> String {
    e.error_string().map_or_else(|_| format!("{:?}", e.0), |s| s.to_string_lossy().into_owned())
}

/// What helps against errors that users meet.
fn todo(error: R) -> &'static str {
    match error {
        R::CUDA_ERROR_NO_DEVICE => "; does nvidia-smi list the GPU, and is it given to this container (--gpus all)?",
        R::CUDA_ERROR_SYSTEM_DRIVER_MISMATCH | R::CUDA_ERROR_UNKNOWN => {
            "; a driver that was updated works once the machine has been started anew"
        }
        R::CUDA_ERROR_OUT_OF_MEMORY => "; other programs hold the GPU's memory (nvidia-smi lists them)",
        _ => "",
    }
}

/// Whether a driver is too old for what is called, or for a compiler: what one of CUDA's whole numbers compiles, drivers
/// of the one before do not run.
fn too_old(driver: i32, compiler: Option<i32>) -> Option<String> {
    let wanted = compiler.map_or(OLDEST, |compiler| OLDEST.max(compiler / 1000 * 1000));
    let number = |version: i32| format!("{}.{}", version / 1000, version % 1000 / 10);
    let by = if wanted > OLDEST { " by the libnvrtc that was found" } else { "" };
    (driver < wanted).then(|| {
        format!(
            "the NVIDIA driver is too old: it knows CUDA {}, and {} is wanted{by}; install driver 580 or newer",
            number(driver),
            number(wanted)
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_driver_has_to_be_as_new_as_what_is_called_and_as_the_compiler() {
        assert!(too_old(11_040, None).unwrap().contains("it knows CUDA 11.4, and 12.8 is wanted;"));
        assert_eq!(too_old(12_080, None), None);
        assert_eq!(too_old(12_090, Some(12_060)), None);
        let reason = too_old(12_090, Some(13_010)).unwrap();
        assert!(reason.contains("13.0 is wanted by the libnvrtc") && reason.contains("580"), "{reason}");
        assert_eq!(too_old(13_000, Some(13_010)), None, "within a whole number older drivers do");
    }

    #[test]
    fn errors_of_the_driver_say_what_to_do() {
        for (error, what) in [
            (R::CUDA_ERROR_NO_DEVICE, "nvidia-smi"),
            (R::CUDA_ERROR_SYSTEM_DRIVER_MISMATCH, "started anew"),
            (R::CUDA_ERROR_OUT_OF_MEMORY, "other programs"),
        ] {
            assert!(todo(error).contains(what));
        }
        assert_eq!(todo(R::CUDA_ERROR_INVALID_VALUE), "");
    }
}
