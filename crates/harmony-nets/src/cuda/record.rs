//! Recording of a chain of operations as a CUDA graph, and its replay.

use std::fmt;
use std::sync::Arc;

use cudarc::driver::{result as driver, sys};

use super::device::{Device, Pool, lock};
use super::{Cuda, Tensor};
use crate::NetError;
use crate::backend::TensorHandle;

/// A recording, or the note that its key was seen once: the first run is not recorded, for it compiles kernels and
/// chooses algorithms, and a single photo should not wait for a recording.
#[derive(Debug)]
pub(super) enum Recording {
    Seen(Vec<Vec<usize>>),
    Ready(Graph),
}

/// A recorded chain with its inputs, its results and all memory in between.
pub(super) struct Graph {
    device: Arc<Device>,
    recorded: sys::CUgraph,
    executable: sys::CUgraphExec,
    inputs: Vec<Tensor>,
    results: Vec<Tensor>,
    pool: Arc<Pool>,
}

// SAFETY: handles of the driver may be used from any thread; a recording is behind a lock.
unsafe impl Send for Graph {}

impl fmt::Debug for Graph {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("graph")
    }
}

impl Drop for Graph {
    fn drop(&mut self) {
        if self.device.bind().is_err() || self.device.synchronize().is_err() {
            return;
        }
        // SAFETY: nothing of it runs any more.
        unsafe {
            let _ = driver::graph::exec_destroy(self.executable);
            let _ = driver::graph::destroy(self.recorded);
        }
        // Results that a caller still holds come back to the pool later and stay there; the rest is freed.
        self.results.clear();
        self.inputs.clear();
        self.device.empty(&self.pool);
    }
}

type Body<'a> = &'a mut dyn FnMut(&[Tensor]) -> Result<Vec<Tensor>, NetError>;

impl Cuda {
    pub(super) fn replay(&self, key: &str, inputs: &[&Tensor], body: Body<'_>) -> Result<Vec<Tensor>, NetError> {
        let device = &self.device;
        let shapes: Vec<Vec<usize>> = inputs.iter().map(|x| x.shape().to_vec()).collect();
        let recording = !Arc::ptr_eq(&lock(&device.pool), &device.common);
        let plain = |body: Body<'_>| body(&inputs.iter().map(|x| (*x).clone()).collect::<Vec<_>>());
        if recording {
            return plain(body);
        }
        device.bind()?;
        let mut records = lock(&self.records);
        match records.get(key) {
            Some(Recording::Ready(graph)) if graph.takes(inputs) => {}
            Some(Recording::Seen(seen)) if *seen == shapes => {
                records.remove(key);
                // What the first run kept is given back, for the recording takes as much again.
                device.synchronize()?;
                device.empty(&device.common);
                match self.record(inputs, body) {
                    Ok(graph) => drop(records.insert(key.into(), Recording::Ready(graph))),
                    // A recording keeps all its memory to itself; where that is too much, it goes on without.
                    Err(NetError::OutOfMemory { .. }) => {
                        drop(records);
                        return plain(body);
                    }
                    Err(e) => return Err(e),
                }
            }
            _ => {
                records.insert(key.into(), Recording::Seen(shapes));
                drop(records);
                return plain(body);
            }
        }
        let Some(Recording::Ready(graph)) = records.get(key) else { return Err(device.refuse("a recording is gone")) };
        for (to, from) in graph.inputs.iter().zip(inputs) {
            // SAFETY: both are that long; all is on one stream.
            let copied = unsafe { driver::memcpy_dtod_async(to.at(), from.at(), to.bytes(), device.stream) };
            device.driver("copying inputs", copied)?;
        }
        // SAFETY: the graph's memory is held by it.
        device.driver("replaying", unsafe { driver::graph::launch(graph.executable, device.stream) })?;
        Ok(graph.results.clone())
    }

    fn record(&self, inputs: &[&Tensor], body: Body<'_>) -> Result<Graph, NetError> {
        let device = &self.device;
        let pool = Arc::new(Pool::default());
        *lock(&device.pool) = Arc::clone(&pool);
        let outcome = self.capture(inputs, body);
        *lock(&device.pool) = Arc::clone(&device.common);
        match outcome {
            Ok((recorded, executable, inputs, results)) => {
                Ok(Graph { device: Arc::clone(device), recorded, executable, inputs, results, pool })
            }
            Err(e) => {
                device.empty(&pool);
                Err(e)
            }
        }
    }

    fn capture(
        &self,
        inputs: &[&Tensor],
        body: Body<'_>,
    ) -> Result<(sys::CUgraph, sys::CUgraphExec, Vec<Tensor>, Vec<Tensor>), NetError> {
        let device = &self.device;
        let own: Vec<Tensor> = inputs.iter().map(|x| self.make(x.shape(), x.dtype())).collect::<Result<_, _>>()?;
        let mode = sys::CUstreamCaptureMode::CU_STREAM_CAPTURE_MODE_RELAXED;
        // SAFETY: the stream lives. Memory is taken from the driver while recording, which the relaxed mode allows.
        device.driver("recording", unsafe { driver::stream::begin_capture(device.stream, mode) })?;
        let results = body(&own);
        // SAFETY: begun above; ended whatever the body said.
        let graph = unsafe { driver::stream::end_capture(device.stream) };
        let results = results?;
        let graph = device.driver("ending a recording", graph)?;
        if graph.is_null() {
            return Err(device.refuse("an empty recording"));
        }
        // SAFETY: the graph was just made.
        let executable = unsafe { driver::graph::instantiate(graph, sys::CUgraphInstantiate_flags(0)) };
        let executable = device.driver("making a recording ready", executable)?;
        Ok((graph, executable, own, results))
    }
}

impl Graph {
    fn takes(&self, inputs: &[&Tensor]) -> bool {
        let same = |(a, b): (&Tensor, &&Tensor)| a.shape() == b.shape() && a.dtype() == b.dtype();
        self.inputs.len() == inputs.len() && self.inputs.iter().zip(inputs).all(same)
    }
}
