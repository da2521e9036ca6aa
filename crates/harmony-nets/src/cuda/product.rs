//! Matrix products by cuBLASLt: the algorithm of a shape is chosen by a measurement when the shape is first seen.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::ffi::c_void;
use std::fmt;
use std::mem::size_of;
use std::sync::Mutex;

use cudarc::cublaslt::result::{self as lt, CublasError};
use cudarc::cublaslt::sys::{
    self, cublasLtEpilogue_t as E, cublasLtMatmulDescAttributes_t as Attribute,
    cublasLtMatmulPreferenceAttributes_t as P, cublasLtMatrixLayoutAttribute_t as L,
};
use cudarc::driver::result as driver;

use super::device::{Device, lock};
use crate::{DType, NetError};

/// Bytes that algorithms may use for themselves.
const WORKSPACE: usize = 64 << 20;
/// Algorithms that are tried.
const TRIED: usize = 8;

/// What is done to the product before it is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Epilogue {
    None,
    Relu,
    GeluTanh,
}

/// The shape of `y [m, n] = epilogue(x [m, k] w + bias) + y0`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[expect(clippy::struct_excessive_bools, reason = "what a product may have or not")]
pub(super) struct Shape {
    pub(super) dtype: DType,
    /// f32 is multiplied as TF32: ten bits of each factor's fraction count.
    pub(super) tf32: bool,
    pub(super) m: usize,
    pub(super) n: usize,
    pub(super) k: usize,
    /// `w` is `[n, k]`, not `[k, n]`.
    pub(super) transposed: bool,
    pub(super) epilogue: Epilogue,
    pub(super) bias: bool,
    pub(super) residual: bool,
    /// Number of products one after the other in memory.
    pub(super) batch: usize,
}

/// Addresses of a product's operands.
#[derive(Debug, Clone, Copy)]
pub(super) struct Operands {
    pub(super) x: u64,
    pub(super) w: u64,
    pub(super) bias: u64,
    pub(super) residual: u64,
    pub(super) y: u64,
}

/// A shape made ready.
struct Plan {
    description: sys::cublasLtMatmulDesc_t,
    x: sys::cublasLtMatrixLayout_t,
    w: sys::cublasLtMatrixLayout_t,
    y: sys::cublasLtMatrixLayout_t,
    algorithm: sys::cublasLtMatmulAlgo_t,
}

// SAFETY: descriptions are plain data of the library; they are used under a lock.
unsafe impl Send for Plan {}

/// The library and the shapes seen so far. `None`: the library has no algorithm for the shape.
pub(super) struct Products {
    handle: sys::cublasLtHandle_t,
    workspace: u64,
    plans: Mutex<HashMap<Shape, Option<Plan>>>,
}

impl fmt::Debug for Products {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("cuBLASLt")
    }
}

impl Products {
    pub(super) fn new(name: &str) -> Result<Self, NetError> {
        let refuse = |reason: String| NetError::Device { device: name.into(), reason };
        let handle = lt::create_handle().map_err(|e| refuse(format!("cuBLASLt: {e}")))?;
        // SAFETY: plain memory, freed in `close`.
        let workspace = unsafe { driver::malloc_sync(WORKSPACE) };
        let workspace = workspace.map_err(|e| refuse(format!("no memory for products: {:?}", e.0)))?;
        Ok(Self { handle, workspace, plans: Mutex::default() })
    }

    pub(super) fn close(&self) {
        for plan in lock(&self.plans).drain().filter_map(|(_, plan)| plan) {
            plan.close();
        }
        // SAFETY: the device is about to be closed; nothing runs any more.
        unsafe {
            let _ = lt::destroy_handle(self.handle);
            let _ = driver::free_sync(self.workspace);
        }
    }

    /// Launches a product; `false` when the library cannot do this shape.
    ///
    /// `scratch` is memory of the result's size to try algorithms on; without it the library's guess is taken.
    pub(super) fn run(
        &self,
        device: &Device,
        shape: Shape,
        operands: Operands,
        scratch: Option<u64>,
    ) -> Result<bool, NetError> {
        let mut plans = lock(&self.plans);
        let plan = match plans.entry(shape) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => {
                let plan = self.plan(device, shape, operands, scratch);
                new.insert(plan.map_err(|e| device.refuse(format!("{shape:?}: {e}")))?)
            }
        };
        let Some(plan) = plan else { return Ok(false) };
        let launch = || self.launch(device, plan, &plan.algorithm, shape, operands);
        let Shape { m, n, k, batch, dtype, tf32, .. } = shape;
        device
            .watched(|| format!("product {dtype:?}{} {batch}x{m}x{n}x{k}", if tf32 { " tf32" } else { "" }), launch)
            .map_err(|e| device.refuse(format!("product {shape:?}: {e}")))?;
        Ok(true)
    }

    /// Whether the algorithm of a shape is still to be chosen.
    pub(super) fn is_new(&self, shape: &Shape) -> bool {
        !lock(&self.plans).contains_key(shape)
    }

    fn launch(
        &self,
        device: &Device,
        plan: &Plan,
        algorithm: &sys::cublasLtMatmulAlgo_t,
        shape: Shape,
        o: Operands,
    ) -> Result<(), CublasError> {
        let (one, factor) = (1f32, if shape.residual { 1f32 } else { 0f32 });
        let c = if shape.residual { o.residual } else { o.y };
        // SAFETY: addresses and descriptions fit one another; all is on one stream.
        unsafe {
            if shape.bias {
                set_description(plan.description, Attribute::CUBLASLT_MATMUL_DESC_BIAS_POINTER, &o.bias)?;
            }
            lt::matmul(
                self.handle,
                plan.description,
                (&raw const one).cast(),
                (&raw const factor).cast(),
                o.w as *const c_void,
                plan.w,
                o.x as *const c_void,
                plan.x,
                c as *const c_void,
                plan.y,
                o.y as *mut c_void,
                plan.y,
                algorithm,
                self.workspace as *mut c_void,
                WORKSPACE,
                device.stream.cast(),
            )
        }
    }

    fn plan(
        &self,
        device: &Device,
        s: Shape,
        operands: Operands,
        scratch: Option<u64>,
    ) -> Result<Option<Plan>, CublasError> {
        // The library thinks in columns: the transposed result `y^T [n, m] = w^T [n, k] x^T [k, m]`.
        let kind =
            if s.dtype == DType::BF16 { sys::cudaDataType_t::CUDA_R_16BF } else { sys::cudaDataType_t::CUDA_R_32F };
        let (m, n, k) = (s.m as u64, s.n as u64, s.k as u64);
        let compute = if s.tf32 && s.dtype == DType::F32 {
            sys::cublasComputeType_t::CUBLAS_COMPUTE_32F_FAST_TF32
        } else {
            sys::cublasComputeType_t::CUBLAS_COMPUTE_32F
        };
        let description = lt::create_matmul_desc(compute, sys::cudaDataType_t::CUDA_R_32F)?;
        let (rows, columns) = if s.transposed { (k, n) } else { (n, k) };
        let plan = Plan {
            description,
            x: lt::create_matrix_layout(kind, k, m, k as i64)?,
            w: lt::create_matrix_layout(kind, rows, columns, rows as i64)?,
            y: lt::create_matrix_layout(kind, n, m, n as i64)?,
            algorithm: sys::cublasLtMatmulAlgo_t { data: [0; 8] },
        };
        let epilogue = match (s.epilogue, s.bias) {
            (Epilogue::None, false) => E::CUBLASLT_EPILOGUE_DEFAULT,
            (Epilogue::None, true) => E::CUBLASLT_EPILOGUE_BIAS,
            (Epilogue::Relu, false) => E::CUBLASLT_EPILOGUE_RELU,
            (Epilogue::Relu, true) => E::CUBLASLT_EPILOGUE_RELU_BIAS,
            (Epilogue::GeluTanh, false) => E::CUBLASLT_EPILOGUE_GELU,
            (Epilogue::GeluTanh, true) => E::CUBLASLT_EPILOGUE_GELU_BIAS,
        };
        // SAFETY: values of the types that the attributes have.
        let found = unsafe {
            set_description(description, Attribute::CUBLASLT_MATMUL_DESC_TRANSA, &i32::from(s.transposed))?;
            set_description(description, Attribute::CUBLASLT_MATMUL_DESC_EPILOGUE, &(epilogue as u32))?;
            if s.bias {
                set_description(description, Attribute::CUBLASLT_MATMUL_DESC_BIAS_POINTER, &operands.bias)?;
            }
            if s.batch > 1 {
                let steps = [(plan.x, s.m * s.k), (plan.w, s.k * s.n), (plan.y, s.m * s.n)];
                for (layout, step) in steps {
                    let (count, step) = (s.batch as i32, step as i64);
                    let at = (&raw const count).cast();
                    lt::set_matrix_layout_attribute(layout, L::CUBLASLT_MATRIX_LAYOUT_BATCH_COUNT, at, 4)?;
                    let at = (&raw const step).cast();
                    lt::set_matrix_layout_attribute(layout, L::CUBLASLT_MATRIX_LAYOUT_STRIDED_BATCH_OFFSET, at, 8)?;
                }
            }
            self.algorithms(&plan)?
        };
        let Some(first) = found.first() else {
            plan.close();
            return Ok(None);
        };
        let mut best = *first;
        if let (Some(scratch), true) = (scratch, found.len() > 1) {
            let trial = Operands { y: scratch, residual: scratch, ..operands };
            let mut least = f32::INFINITY;
            for algorithm in &found {
                if let Ok(time) = self.time(device, &plan, algorithm, s, trial)
                    && time < least
                {
                    (least, best) = (time, *algorithm);
                }
            }
        }
        Ok(Some(Plan { algorithm: best, ..plan }))
    }

    /// The library's algorithms for a plan, best guess first.
    unsafe fn algorithms(&self, plan: &Plan) -> Result<Vec<sys::cublasLtMatmulAlgo_t>, CublasError> {
        let preference = lt::create_matmul_pref()?;
        // SAFETY: all descriptions live; results beyond `count` are not read.
        unsafe {
            let at = (&raw const WORKSPACE_BYTES).cast();
            lt::set_matmul_pref_attribute(preference, P::CUBLASLT_MATMUL_PREF_MAX_WORKSPACE_BYTES, at, 8)?;
            let mut results: [sys::cublasLtMatmulHeuristicResult_t; TRIED] = std::mem::zeroed();
            let mut count = 0;
            let status = sys::cublasLtMatmulAlgoGetHeuristic(
                self.handle,
                plan.description,
                plan.w,
                plan.x,
                plan.y,
                plan.y,
                preference,
                TRIED as i32,
                results.as_mut_ptr(),
                &raw mut count,
            );
            let _ = lt::destroy_matmul_pref(preference);
            if status.result().is_err() {
                return Ok(Vec::new());
            }
            let usable = results.iter().take(count.max(0) as usize).filter(|r| r.state.result().is_ok());
            Ok(usable.map(|r| r.algo).collect())
        }
    }

    /// Milliseconds of one product by an algorithm.
    fn time(
        &self,
        device: &Device,
        plan: &Plan,
        algorithm: &sys::cublasLtMatmulAlgo_t,
        shape: Shape,
        operands: Operands,
    ) -> Result<f32, CublasError> {
        const ROUNDS: usize = 4;
        let failed = |_| CublasError(sys::cublasStatus_t::CUBLAS_STATUS_INTERNAL_ERROR);
        let flags = cudarc::driver::sys::CUevent_flags::CU_EVENT_DEFAULT;
        let (start, end) =
            (driver::event::create(flags).map_err(failed)?, driver::event::create(flags).map_err(failed)?);
        let run = || {
            self.launch(device, plan, algorithm, shape, operands)?;
            // SAFETY: events and stream live.
            unsafe { driver::event::record(start, device.stream) }.map_err(failed)?;
            for _ in 0..ROUNDS {
                self.launch(device, plan, algorithm, shape, operands)?;
            }
            // SAFETY: as above.
            unsafe {
                driver::event::record(end, device.stream).map_err(failed)?;
                driver::event::synchronize(end).map_err(failed)?;
                driver::event::elapsed(start, end).map_err(failed)
            }
        };
        let time = run();
        // SAFETY: not used any more.
        unsafe {
            let _ = driver::event::destroy(start);
            let _ = driver::event::destroy(end);
        }
        Ok(time? / ROUNDS as f32)
    }
}

static WORKSPACE_BYTES: u64 = WORKSPACE as u64;

unsafe fn set_description<T>(
    description: sys::cublasLtMatmulDesc_t,
    attribute: Attribute,
    value: &T,
) -> Result<(), CublasError> {
    // SAFETY: the caller's value is of the attribute's type.
    unsafe { lt::set_matmul_desc_attribute(description, attribute, std::ptr::from_ref(value).cast(), size_of::<T>()) }
}

impl Plan {
    fn close(self) {
        // SAFETY: made in `plan`, not used any more.
        unsafe {
            for layout in [self.x, self.w, self.y] {
                let _ = lt::destroy_matrix_layout(layout);
            }
            let _ = lt::destroy_matmul_desc(self.description);
        }
    }
}

// SAFETY: the library's handle may be used from any thread; plans are behind a lock.
unsafe impl Send for Products {}
// SAFETY: as above.
unsafe impl Sync for Products {}
