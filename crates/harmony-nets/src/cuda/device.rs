//! The device: context, stream, memory, kernels compiled at run time.

use std::collections::{BTreeMap, HashMap};
use std::ffi::{CString, c_char, c_void};
use std::fmt;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use cudarc::driver::result::{self as driver, DriverError};
use cudarc::driver::sys::{self, CUdevice_attribute_enum as A};
use cudarc::nvrtc;
use rayon::prelude::*;

use super::presence::{self, absent, first, words};
use super::product::Products;
use super::profile::Profile;
use crate::NetError;

/// Locks, whatever happened to a thread that held it before.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// One source file of kernels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Source {
    Pointwise,
    Rows,
    Images,
    Attention,
    /// Attention on the matrix units for heads of at most so many numbers (a multiple of 16).
    Flash(usize),
    /// The same for heads of 64 numbers with the warp-group instructions of compute capability 9.0.
    GroupAttention,
    /// Convolution with these instructions: so many channels a block, so many stages, of this type.
    GroupConvolution(usize, usize, bool),
}

impl Source {
    fn text(self) -> String {
        let body = match self {
            Self::Pointwise => include_str!("pointwise.cu"),
            Self::Rows => include_str!("rows.cu"),
            Self::Images => include_str!("images.cu"),
            Self::Attention | Self::Flash(_) => include_str!("attention.cu"),
            Self::GroupAttention | Self::GroupConvolution(..) => include_str!("hopper.cu"),
        };
        let defines = match self {
            Self::Flash(head) => format!("#define FLASH\n#define HEAD {head}\n"),
            Self::GroupAttention => "#define ATTENTION\n".into(),
            Self::GroupConvolution(wide, stages, bf16) => {
                let kind = if bf16 { "#define BF16\n" } else { "" };
                format!("#define CONVOLUTION\n{kind}#define WIDE {wide}\n#define STAGES {stages}\n")
            }
            _ => String::new(),
        };
        defines + include_str!("prelude.cu") + body
    }
}

/// A compiled kernel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Kernel(sys::CUfunction);

// SAFETY: handles of the driver may be used from any thread.
unsafe impl Send for Kernel {}
// SAFETY: as above.
unsafe impl Sync for Kernel {}

/// Arguments of a launch, each at a multiple of eight bytes.
#[derive(Debug, Default)]
pub(super) struct Args {
    words: Vec<u64>,
    starts: Vec<usize>,
}

impl Args {
    pub(super) fn new() -> Self {
        Self::default()
    }

    pub(super) fn with<T: bytemuck::NoUninit>(mut self, value: T) -> Self {
        let (bytes, start) = (bytemuck::bytes_of(&value), self.words.len());
        self.starts.push(start);
        self.words.resize(start + bytes.len().div_ceil(8), 0);
        bytemuck::cast_slice_mut::<u64, u8>(&mut self.words[start..])[..bytes.len()].copy_from_slice(bytes);
        self
    }
}

/// Bytes that are copied at a time by way of page-locked memory.
const STAGED: usize = 32 << 20;
/// Fewer bytes than this are copied by the driver alone.
const WORTH_STAGING: usize = 1 << 20;

/// Memory of the device that was used before and may be used again: all work is on one stream, so what is given back
/// here is free for whatever is launched next.
#[derive(Debug, Default)]
pub(super) struct Pool {
    free: Mutex<BTreeMap<usize, Vec<u64>>>,
}

/// A piece of device memory.
pub(super) struct Buffer {
    pub(super) address: u64,
    size: usize,
    pool: Arc<Pool>,
    /// Keeps the context alive as long as there is memory of it.
    _device: Arc<Device>,
}

impl fmt::Debug for Buffer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} bytes", self.size)
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        lock(&self.pool.free).entry(self.size).or_default().push(self.address);
    }
}

/// An NVIDIA GPU and everything that was set up on it.
pub(super) struct Device {
    context: sys::CUcontext,
    handle: sys::CUdevice,
    pub(super) stream: sys::CUstream,
    pub(super) name: String,
    /// Compute capability, such as 90.
    pub(super) arch: i32,
    /// Whether there are warp-group products: compute capability 9.0 alone has them in this form.
    pub(super) groups: bool,
    pub(super) processors: u32,
    kernels: Mutex<HashMap<(Source, &'static str), Kernel>>,
    modules: Mutex<HashMap<Source, usize>>,
    /// Where tensors are made now: the common pool, or the one of a recording.
    pub(super) pool: Mutex<Arc<Pool>>,
    pub(super) common: Arc<Pool>,
    pub(super) products: Products,
    /// Bytes taken from the driver and not given back, now and at most.
    taken: AtomicUsize,
    most: AtomicUsize,
    /// What ran and how long, while somebody wants to know.
    pub(super) profile: Mutex<Option<Profile>>,
    /// Memory of the host that the GPU copies from and to by itself; made when it is first needed.
    staging: Mutex<Option<Staging>>,
}

/// Page-locked memory of the host, [`STAGED`] bytes.
struct Staging(*mut c_void);

// SAFETY: plain memory, used under a lock.
unsafe impl Send for Staging {}

impl Staging {
    fn bytes(&mut self) -> &mut [u8] {
        // SAFETY: it is that long, was filled with zeros, and is borrowed as this is.
        unsafe { std::slice::from_raw_parts_mut(self.0.cast(), STAGED) }
    }
}

// SAFETY: handles of the driver may be used from any thread whose context is bound; every use binds it first.
unsafe impl Send for Device {}
// SAFETY: as above; what changes is behind locks.
unsafe impl Sync for Device {}

impl fmt::Debug for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)
    }
}

impl Device {
    pub(super) fn open(ordinal: i32) -> Result<Arc<Self>, NetError> {
        presence::check()?;
        let count = driver::device::get_count().map_err(first)?;
        if ordinal < 0 || ordinal >= count {
            return Err(absent(format!("no GPU number {ordinal}; the driver sees {count}")));
        }
        let handle = driver::device::get(ordinal).map_err(first)?;
        let name = driver::device::get_name(handle).map_err(first)?;
        let attribute = |a| {
            // SAFETY: the device exists.
            unsafe { driver::device::get_attribute(handle, a) }.map_err(first)
        };
        let arch = attribute(A::CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR)? * 10
            + attribute(A::CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MINOR)?;
        let processors = attribute(A::CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT)?.max(1) as u32;
        // SAFETY: the device exists; the context is released when the device is dropped.
        let context = unsafe { driver::primary_ctx::retain(handle) }.map_err(first)?;
        // SAFETY: the context was just retained.
        unsafe { driver::ctx::set_current(context) }.map_err(first)?;
        let stream = driver::stream::create(driver::stream::StreamKind::NonBlocking).map_err(first)?;
        let products = Products::new(&name)?;
        let common = Arc::new(Pool::default());
        let device = Arc::new(Self {
            context,
            handle,
            stream,
            name,
            arch,
            // For tests: the kernels of other GPUs on this one.
            groups: arch == 90 && std::env::var_os("HARMONY_CUDA").is_none_or(|v| v != "plain"),
            processors,
            profile: Mutex::default(),
            staging: Mutex::default(),
            kernels: Mutex::default(),
            modules: Mutex::default(),
            pool: Mutex::new(Arc::clone(&common)),
            common,
            products,
            taken: AtomicUsize::new(0),
            most: AtomicUsize::new(0),
        });
        device.prepare()?;
        Ok(device)
    }

    /// Gets the kernels that every network uses, each file on a thread of its own: compiling takes seconds.
    fn prepare(&self) -> Result<(), NetError> {
        let mut sources = vec![Source::Pointwise, Source::Rows, Source::Images, Source::Attention];
        if self.arch >= 80 {
            sources.push(Source::Flash(64));
        }
        if self.groups {
            sources.push(Source::GroupAttention);
        }
        std::thread::scope(|scope| {
            let threads: Vec<_> = sources.into_iter().map(|s| scope.spawn(move || self.module(s))).collect();
            threads.into_iter().try_for_each(|t| match t.join() {
                Ok(outcome) => outcome.map(drop),
                Err(_) => Err(self.refuse("a thread that prepared kernels panicked")),
            })
        })
    }

    pub(super) fn refuse(&self, what: impl fmt::Display) -> NetError {
        NetError::Device { device: self.name.clone(), reason: what.to_string() }
    }

    pub(super) fn driver<T>(&self, what: &str, result: Result<T, DriverError>) -> Result<T, NetError> {
        result.map_err(|e| self.refuse(format!("{what}: {}", words(e))))
    }

    /// Makes the context current for this thread; every entry from outside calls it.
    pub(super) fn bind(&self) -> Result<(), NetError> {
        // SAFETY: the context lives as long as this.
        self.driver("binding the context", unsafe { driver::ctx::set_current(self.context) })
    }

    pub(super) fn synchronize(&self) -> Result<(), NetError> {
        // SAFETY: the stream lives as long as this.
        self.driver("waiting", unsafe { driver::stream::synchronize(self.stream) })
    }

    /// Bytes of device memory that this holds now and has held at most.
    pub(super) fn memory(&self) -> (usize, usize) {
        (self.taken.load(Ordering::Relaxed), self.most.load(Ordering::Relaxed))
    }

    /// Copies to the device. The bytes have been read when this returns.
    pub(super) fn upload(&self, to: u64, bytes: &[u8]) -> Result<(), NetError> {
        self.bind()?;
        let copy = |to: u64, bytes: &[u8]| {
            // SAFETY: the callers' buffer is that large; pageable memory has been read when the call returns, and
            // page-locked memory is only written again after a wait.
            let copied = unsafe { driver::memcpy_htod_async(to, bytes, self.stream) };
            self.driver("copying to the device", copied)
        };
        // In use by another thread, or by this one further up (a thread of rayon's that waits takes other work): plainly.
        let mut staging = self.staging.try_lock().ok();
        let staged = staging.as_deref_mut().and_then(|s| Self::staging_for(s, bytes.len()));
        let Some(staging) = staged else { return copy(to, bytes) };
        for (i, part) in bytes.chunks(STAGED).enumerate() {
            let here = &mut staging.bytes()[..part.len()];
            here.par_chunks_mut(1 << 20).zip(part.par_chunks(1 << 20)).for_each(|(to, from)| to.copy_from_slice(from));
            copy(to + (i * STAGED) as u64, here)?;
            self.synchronize()?;
        }
        Ok(())
    }

    /// Copies from the device and waits for it.
    pub(super) fn download(&self, to: &mut [u8], from: u64) -> Result<(), NetError> {
        self.bind()?;
        let copy = |to: &mut [u8], from: u64| {
            // SAFETY: the callers' buffer is that large; waited for at once.
            let copied = unsafe { driver::memcpy_dtoh_async(to, from, self.stream) };
            self.driver("copying from the device", copied)?;
            self.synchronize()
        };
        // In use by another thread, or by this one further up (a thread of rayon's that waits takes other work): plainly.
        let mut staging = self.staging.try_lock().ok();
        let staged = staging.as_deref_mut().and_then(|s| Self::staging_for(s, to.len()));
        let Some(staging) = staged else { return copy(to, from) };
        for (i, part) in to.chunks_mut(STAGED).enumerate() {
            let here = &mut staging.bytes()[..part.len()];
            copy(here, from + (i * STAGED) as u64)?;
            part.par_chunks_mut(1 << 20).zip(here.par_chunks(1 << 20)).for_each(|(to, from)| to.copy_from_slice(from));
        }
        Ok(())
    }

    /// Page-locked memory, where it is worth it and there is some to be had.
    fn staging_for(staging: &mut Option<Staging>, bytes: usize) -> Option<&mut Staging> {
        if bytes < WORTH_STAGING {
            return None;
        }
        if staging.is_none() {
            // SAFETY: freed when the device is dropped; zeros are written before anything reads it.
            let memory = unsafe { driver::malloc_host(STAGED, 0) }.ok()?;
            // SAFETY: just got, that long.
            unsafe { memory.cast::<u8>().write_bytes(0, STAGED) };
            *staging = Some(Staging(memory));
        }
        staging.as_mut()
    }

    /// Bytes of the device's memory that are free, and all of them.
    pub(super) fn device_memory(&self) -> Option<(usize, usize)> {
        self.bind().ok()?;
        driver::mem_get_info().ok()
    }

    /// A piece of memory with anything in it.
    pub(super) fn take(self: &Arc<Self>, bytes: usize) -> Result<Buffer, NetError> {
        self.bind()?;
        let grain = if bytes > 1 << 20 { 1 << 18 } else { 512 };
        let size = bytes.max(1).next_multiple_of(grain);
        let pool = Arc::clone(&lock(&self.pool));
        let buffer = |address, size, pool| Buffer { address, size, pool, _device: Arc::clone(self) };
        {
            let mut free = lock(&pool.free);
            let fit = free.range_mut(size..=size + size / 4).find(|(_, v)| !v.is_empty());
            if let Some((found, address)) = fit.and_then(|(s, v)| v.pop().map(|a| (*s, a))) {
                drop(free);
                return Ok(buffer(address, found, pool));
            }
        }
        // SAFETY: plain memory of the driver; freed when a pool is emptied.
        let mut got = unsafe { driver::malloc_sync(size) };
        if got.is_err() {
            self.empty(&pool);
            // SAFETY: as above.
            got = unsafe { driver::malloc_sync(size) };
        }
        match got {
            Ok(address) => {
                let now = self.taken.fetch_add(size, Ordering::Relaxed) + size;
                self.most.fetch_max(now, Ordering::Relaxed);
                Ok(buffer(address, size, pool))
            }
            Err(DriverError(sys::CUresult::CUDA_ERROR_OUT_OF_MEMORY)) => {
                let free = driver::mem_get_info().map_or(0, |(free, _)| free);
                let device = self.name.clone();
                Err(NetError::OutOfMemory { device, needed: size as u64, free: free as u64 })
            }
            Err(e) => Err(self.refuse(format!("allocating {size} bytes: {}", words(e)))),
        }
    }

    /// Gives what a pool keeps free back to the driver.
    pub(super) fn empty(&self, pool: &Pool) {
        let kept = std::mem::take(&mut *lock(&pool.free));
        if kept.is_empty() || self.bind().is_err() {
            return;
        }
        for (size, addresses) in kept {
            for address in addresses {
                // SAFETY: nobody holds it. The driver waits for work that uses it. A failure leaks it, no more.
                let _ = unsafe { driver::free_sync(address) };
                self.taken.fetch_sub(size, Ordering::Relaxed);
            }
        }
    }

    /// A kernel, compiled when it is first asked for.
    fn kernel(&self, source: Source, name: &'static str) -> Result<Kernel, NetError> {
        if let Some(kernel) = lock(&self.kernels).get(&(source, name)) {
            return Ok(*kernel);
        }
        let module = self.module(source)?;
        let c_name = CString::new(name).map_err(|e| self.refuse(e))?;
        // SAFETY: the module was loaded and is never unloaded.
        let function = unsafe { driver::module::get_function(module as sys::CUmodule, c_name) };
        let kernel = Kernel(self.driver(name, function)?);
        lock(&self.kernels).insert((source, name), kernel);
        Ok(kernel)
    }

    fn module(&self, source: Source) -> Result<usize, NetError> {
        if let Some(module) = lock(&self.modules).get(&source) {
            return Ok(*module);
        }
        self.bind()?;
        let text = source.text();
        let kept = self.kept(&text);
        let load = |code: &[u8]| {
            // SAFETY: the driver checks the image; a bad one is an error.
            unsafe { driver::module::load_data(code.as_ptr().cast::<c_void>()) }
        };
        let found = kept.as_ref().and_then(|path| std::fs::read(path).ok()).and_then(|code| load(&code).ok());
        let module = if let Some(module) = found {
            module
        } else {
            let code = self.compile(&text)?;
            if let Some(path) = kept {
                keep(&path, &code);
            }
            self.driver("loading kernels", load(&code))?
        };
        // Two threads may have loaded the same; either will do.
        Ok(*lock(&self.modules).entry(source).or_insert(module as usize))
    }

    /// Where the compiled form of a source is kept between runs; `None` without a cache folder.
    fn kept(&self, text: &str) -> Option<PathBuf> {
        let folder = std::env::var_os("HARMONY_CACHE").map(PathBuf::from).or_else(|| {
            let base = std::env::var_os("XDG_CACHE_HOME").map(PathBuf::from);
            let base = base.or_else(|| std::env::var_os("HOME").map(|home| PathBuf::from(home).join(".cache")))?;
            Some(base.join("harmony"))
        })?;
        // FNV-1a: the name only has to change when the source, the architecture or the compiler does.
        let (mut major, mut minor) = (0, 0);
        // SAFETY: two numbers are written.
        unsafe { nvrtc::sys::nvrtcVersion(&raw mut major, &raw mut minor) }.result().ok()?;
        let tag = format!("{major}.{minor} {} {} ", self.arch, self.groups);
        let hash = tag
            .bytes()
            .chain(text.bytes())
            .fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
        Some(folder.join("kernels").join(format!("{hash:016x}.cubin")))
    }

    fn compile(&self, text: &str) -> Result<Vec<u8>, NetError> {
        let text = CString::new(text).map_err(|e| self.refuse(e))?;
        let program = nvrtc::result::create_program(&text, None).map_err(|e| self.refuse(e))?;
        let options = [
            format!("--gpu-architecture=sm_{}{}", self.arch, if self.groups { "a" } else { "" }),
            "--std=c++17".into(),
        ];
        // SAFETY: the program was just made and is destroyed below.
        let code = unsafe {
            let compiled = nvrtc::result::compile_program(program, &options);
            let code = compiled.map_err(|e| {
                let log = nvrtc::result::get_program_log(program).unwrap_or_default();
                let log: Vec<u8> = log.iter().map(|c| c.cast_unsigned()).filter(|c| *c != 0).collect();
                self.refuse(format!("compiling kernels: {e}\n{}", String::from_utf8_lossy(&log)))
            });
            let code = code.and_then(|()| {
                let mut size = 0usize;
                nvrtc::sys::nvrtcGetCUBINSize(program, &raw mut size).result().map_err(|e| self.refuse(e))?;
                let mut code = vec![0u8; size];
                let to = code.as_mut_ptr().cast::<c_char>();
                nvrtc::sys::nvrtcGetCUBIN(program, to).result().map_err(|e| self.refuse(e))?;
                Ok(code)
            });
            let _ = nvrtc::result::destroy_program(program);
            code?
        };
        Ok(code)
    }

    /// Launches a kernel; nothing happens for an empty grid.
    pub(super) fn launch(
        &self,
        (source, name): (Source, &'static str),
        grid: [usize; 3],
        threads: u32,
        shared: usize,
        mut args: Args,
    ) -> Result<(), NetError> {
        if grid.contains(&0) {
            return Ok(());
        }
        self.bind()?;
        let kernel = self.kernel(source, name)?;
        let too_large = |_| self.refuse(format!("{name}: a grid of {grid:?}"));
        let [x, y, z] = [u32::try_from(grid[0]), u32::try_from(grid[1]), u32::try_from(grid[2])];
        let grid = (x.map_err(too_large)?, y.map_err(too_large)?, z.map_err(too_large)?);
        let base = args.words.as_mut_ptr();
        // SAFETY: every start lies inside the words.
        let mut pointers: Vec<*mut c_void> = args.starts.iter().map(|s| unsafe { base.add(*s) }.cast()).collect();
        // SAFETY: the callers' arguments are those of the kernels, and the buffers they point to live until the
        // stream has passed this launch, for memory is only used again on the same stream.
        let launched = unsafe {
            if shared > 48 << 10 {
                let attribute = sys::CUfunction_attribute_enum::CU_FUNC_ATTRIBUTE_MAX_DYNAMIC_SHARED_SIZE_BYTES;
                let set = driver::function::set_function_attribute(kernel.0, attribute, shared as i32);
                self.driver(name, set)?;
            }
            let run =
                || driver::launch_kernel(kernel.0, grid, (threads, 1, 1), shared as u32, self.stream, &mut pointers);
            self.watched(|| format!("{name} {source:?}"), run)
        };
        self.driver(name, launched)
    }

    /// Launches a kernel that strides over `n` pieces of work.
    pub(super) fn launch_over(&self, what: (Source, &'static str), n: usize, args: Args) -> Result<(), NetError> {
        let blocks = n.div_ceil(256).min(self.processors as usize * 16);
        self.launch(what, [blocks, 1, 1], 256, 0, args)
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        if self.synchronize().is_err() {
            return;
        }
        self.empty(&Arc::clone(&self.common));
        if let Some(Staging(memory)) = lock(&self.staging).take() {
            // SAFETY: nothing is copied any more.
            let _ = unsafe { driver::free_host(memory) };
        }
        self.products.close();
        // SAFETY: nothing of this is used any more.
        unsafe {
            let _ = driver::stream::destroy(self.stream);
            let _ = driver::primary_ctx::release(self.handle);
        }
    }
}

/// Writes a file whole or not at all; without the folder it is compiled again next time.
fn keep(path: &std::path::Path, code: &[u8]) {
    let Some(folder) = path.parent() else { return };
    let half = path.with_extension(format!("{}.part", std::process::id()));
    let written = std::fs::create_dir_all(folder).and_then(|()| std::fs::write(&half, code));
    if written.and_then(|()| std::fs::rename(&half, path)).is_err() {
        let _ = std::fs::remove_file(&half);
    }
}
