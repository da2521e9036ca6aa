//! Running a job: script and job file in, images out, and nothing left behind.

use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use harmony_scene::Camera;
use rustix::process::{Pid, Signal, kill_process_group};

use super::{BlenderKind, CyclesJob, CyclesOutput, CyclesRenderer, LitError, outputs};

/// The one script that Blender runs; it takes a job file and nothing else.
const SCRIPT: &str = include_str!("../../blender/render.py");
/// The modules that it imports from its own folder.
const MODULES: [(&str, &str); 4] = [
    ("albedo.py", include_str!("../../blender/albedo.py")),
    ("apart.py", include_str!("../../blender/apart.py")),
    ("textures.py", include_str!("../../blender/textures.py")),
    ("views.py", include_str!("../../blender/views.py")),
];
/// Lines of Blender's log that are kept for an error.
const TAIL_LINES: usize = 30;
/// Longest line that is kept.
const LINE_LIMIT: usize = 300;

/// How far a render is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Samples done.
    pub sample: u32,
    /// Samples wanted.
    pub of: u32,
}

impl CyclesRenderer {
    /// Renders one job and waits for it.
    ///
    /// # Errors
    /// [`LitError`]: no scene, a time-out, or a failure of Blender with the end of its log.
    pub fn render(&self, job: &CyclesJob) -> Result<CyclesOutput, LitError> {
        self.render_with(job, &mut |_| {})
    }

    /// As [`Self::render`], with progress.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn render_with(&self, job: &CyclesJob, progress: &mut dyn FnMut(Progress)) -> Result<CyclesOutput, LitError> {
        job.check()?;
        let io = |what: &'static str| move |source| LitError::Io { what, source };
        let folder = tempfile::Builder::new().prefix("harmony-cycles-").tempdir();
        let folder = folder.map_err(io("make a temporary folder for Blender"))?;
        let script = folder.path().join("render.py");
        std::fs::write(&script, SCRIPT).map_err(io("write Blender's script"))?;
        for (name, text) in MODULES {
            std::fs::write(folder.path().join(name), text).map_err(io("write Blender's script"))?;
        }
        let job_file = folder.path().join("job.json");
        std::fs::write(&job_file, job.to_json(folder.path())?).map_err(io("write Blender's job"))?;

        let started = Instant::now();
        let mut command = Command::new(&self.program);
        match self.kind {
            BlenderKind::Module => command.arg(&script),
            BlenderKind::Program => {
                command.args(["--background", "--factory-startup", "--python-exit-code", "9", "--python"]);
                command.arg(&script).arg("--")
            }
        };
        command.arg(&job_file).current_dir(folder.path()).env("PYTHONDONTWRITEBYTECODE", "1");
        let (status, tail) = run(command, job.timeout, progress)?;
        let result = folder.path().join("result.json");
        if !status.success() || !result.exists() {
            return Err(LitError::Failed { status: status.to_string(), log_tail: tail });
        }
        outputs::read(job, folder.path(), started.elapsed())
    }
}

/// A started process group; whatever happens here, it ends.
struct Group {
    child: Child,
    ended: bool,
}

impl Group {
    fn kill(&mut self) {
        if let Some(pid) = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw) {
            let _ = kill_process_group(pid, Signal::KILL);
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
        self.ended = true;
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        if !self.ended {
            self.kill();
        }
    }
}

/// How long the pipes of a process that has ended are read at most.
const LAST_WORDS: Duration = Duration::from_secs(2);

/// Runs a command to its end or to the limit; returns its status and the end of what it said.
pub(super) fn run(
    mut command: Command,
    limit: Duration,
    progress: &mut dyn FnMut(Progress),
) -> Result<(ExitStatus, String), LitError> {
    use std::os::unix::process::CommandExt;
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).process_group(0);
    let started = Instant::now();
    let mut child = command.spawn().map_err(|source| LitError::Io { what: "start Blender", source })?;
    let (sender, lines) = channel();
    let readers = [
        child.stdout.take().map(|s| read_lines(s, sender.clone())),
        child.stderr.take().map(|s| read_lines(s, sender)),
    ];
    let mut group = Group { child, ended: false };
    let mut tail = VecDeque::new();
    let status = loop {
        listen(&lines, &mut tail, progress);
        match group.child.try_wait() {
            Ok(Some(status)) => break status,
            Ok(None) => {}
            Err(source) => return Err(LitError::Io { what: "wait for Blender", source }),
        }
        if started.elapsed() >= limit {
            group.kill();
            listen(&lines, &mut tail, progress);
            return Err(LitError::Timeout { limit, log_tail: join(&tail) });
        }
    };
    group.ended = true;
    // What it said last is still in the pipes; a grandchild that holds them open is not waited for.
    let ended = Instant::now();
    while ended.elapsed() < LAST_WORDS {
        if readers.iter().flatten().all(std::thread::JoinHandle::is_finished) {
            break;
        }
        listen(&lines, &mut tail, progress);
    }
    listen(&lines, &mut tail, progress);
    Ok((status, join(&tail)))
}

/// Takes what has been said, waiting a moment for something.
fn listen(lines: &Receiver<String>, tail: &mut VecDeque<String>, progress: &mut dyn FnMut(Progress)) {
    let mut wait = Duration::from_millis(50);
    loop {
        match lines.recv_timeout(wait) {
            Ok(line) => {
                if let Some(at) = parse_progress(&line) {
                    progress(at);
                } else {
                    tail.push_back(line);
                    if tail.len() > TAIL_LINES {
                        tail.pop_front();
                    }
                }
            }
            Err(RecvTimeoutError::Timeout) => return,
            // All said; without this pause the caller would spin until the process is gone.
            Err(RecvTimeoutError::Disconnected) => {
                std::thread::sleep(Duration::from_millis(10));
                return;
            }
        }
        wait = Duration::ZERO;
    }
}

fn read_lines(stream: impl Read + Send + 'static, to: Sender<String>) -> std::thread::JoinHandle<()> {
    std::thread::spawn(move || {
        let mut reader = BufReader::new(stream);
        let mut line = Vec::new();
        while reader.read_until(b'\n', &mut line).is_ok_and(|n| n > 0) {
            line.truncate(LINE_LIMIT);
            let text = String::from_utf8_lossy(&line).trim_end().to_owned();
            line.clear();
            if !text.is_empty() && to.send(text).is_err() {
                return;
            }
        }
    })
}

fn join(tail: &VecDeque<String>) -> String {
    tail.iter().map(String::as_str).collect::<Vec<_>>().join("\n")
}

/// `HARMONY sample 3/64`.
fn parse_progress(line: &str) -> Option<Progress> {
    let (sample, of) = line.trim().strip_prefix("HARMONY sample ")?.split_once('/')?;
    Some(Progress { sample: sample.parse().ok()?, of: of.parse().ok()? })
}

impl CyclesJob {
    /// Checks that the job can be done at all.
    ///
    /// # Errors
    /// [`LitError::NoScene`], [`LitError::BadJob`].
    pub fn check(&self) -> Result<(), LitError> {
        if !self.glb.is_file() {
            return Err(LitError::NoScene { path: self.glb.clone() });
        }
        let bad = |reason: String| Err(LitError::BadJob { reason });
        let size = self.camera.size;
        if !(1..=8192).contains(&size.width) || !(1..=8192).contains(&size.height) {
            return bad(format!("the image would be {} x {} pixels, 8192 is the limit", size.width, size.height));
        }
        if !(1..=4096).contains(&self.samples) {
            return bad(format!("{} samples a pixel, 1 to 4096 are possible", self.samples));
        }
        let k = &self.camera.intrinsics;
        let pose_ok = self.camera.rotation.is_finite() && self.camera.centre().is_finite();
        if !(k.fx > 0.0 && k.fy > 0.0 && [k.fx, k.fy, k.cx, k.cy].iter().all(|v| v.is_finite()) && pose_ok) {
            return bad("the camera is not finite or has no focal length".to_owned());
        }
        if let Some(field) = &self.albedo {
            let cells = (field.columns * field.rows) as usize;
            let odd = |c: &harmony_scene::AlbedoCells| !c.factors.is_empty() && c.factors.len() != cells;
            if let Some((name, cells)) = field.nodes.iter().find(|(_, c)| odd(c)) {
                return bad(format!("the albedo field of {name} has {} cells", cells.factors.len()));
            }
        }
        let l = &self.lighting;
        let numbers = l.ambient_color.iter().chain([&l.ambient_intensity, &l.exposure]);
        let of_lights = l.lights.iter().flat_map(|l| l.position.iter().chain(&l.color).chain([&l.intensity]));
        if let Some(v) = numbers.chain(of_lights).find(|v| !v.is_finite()) {
            return bad(format!("the lighting holds {v}"));
        }
        Ok(())
    }

    /// The job file, for the script.
    fn to_json(&self, folder: &Path) -> Result<String, LitError> {
        let absolute = std::path::absolute(&self.glb)
            .map_err(|source| LitError::Io { what: "find the scene's full path", source })?;
        let mode = match self.mode {
            super::RenderMode::Lit => "lit",
            super::RenderMode::PerLight => "per_light",
            super::RenderMode::Ids => "ids",
        };
        let job = serde_json::json!({
            "glb": absolute,
            "folder": folder,
            "mode": mode,
            "samples": self.samples,
            "denoise": self.denoise,
            "view": self.lighting.view,
            "views": self.views,
            "hidden_nodes": self.hidden_nodes,
            "node_ids": self.node_ids,
            "background": self.background,
            "delight": self.delight,
            "true_colors": self.true_colors,
            "albedo": self.albedo.as_ref().map(|field| serde_json::json!({
                "camera": camera_json(&Camera::from(&field.camera)),
                "columns": field.columns,
                "rows": field.rows,
                "nodes": field.nodes,
                "other": field.other,
            })),
            "seed": self.seed,
            "threads": self.threads,
            "memory_limit_mb": self.memory_limit_mb,
            "room": self.room.map(|e| e.as_vec().to_array()),
            "camera": camera_json(&self.camera),
            "lighting": self.lighting,
        });
        Ok(job.to_string())
    }
}

/// A camera for the script: OpenCV, rows of R.
fn camera_json(camera: &Camera) -> serde_json::Value {
    let k = &camera.intrinsics;
    let r = camera.rotation.transpose();
    serde_json::json!({
        "width": camera.size.width, "height": camera.size.height,
        "fx": k.fx, "fy": k.fy, "cx": k.cx, "cy": k.cy,
        "rotation": [r.x_axis.to_array(), r.y_axis.to_array(), r.z_axis.to_array()],
        "centre": camera.centre().to_array(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str) -> Command {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        command
    }

    #[test]
    fn progress_and_the_end_of_the_log_come_through() {
        let mut seen = Vec::new();
        let script = "echo HARMONY sample 3/64; echo bad >&2; i=0; while [ $i -lt 50 ]; do echo line $i; i=$((i+1)); done; exit 7";
        let (status, tail) = run(shell(script), Duration::from_secs(20), &mut |p| seen.push(p)).unwrap();
        assert_eq!(status.code(), Some(7));
        assert_eq!(seen, [Progress { sample: 3, of: 64 }]);
        assert!(tail.contains("line 49"), "{tail}");
        assert!(!tail.contains("line 3\n"), "only the end is kept");
    }

    #[test]
    fn a_hanging_process_is_ended_with_its_children() {
        let marker = format!("{}.5", 4000 + std::process::id() % 1000);
        let started = Instant::now();
        let script = format!("echo here; sleep {marker} & sleep {marker}; wait");
        let error = run(shell(&script), Duration::from_millis(400), &mut |_| {}).unwrap_err();
        assert!(started.elapsed() < Duration::from_secs(10));
        assert!(matches!(&error, LitError::Timeout { log_tail, .. } if log_tail == "here"), "{error}");
        std::thread::sleep(Duration::from_millis(200));
        let left = std::fs::read_dir("/proc").into_iter().flatten().flatten().filter(|e| {
            let command = std::fs::read(e.path().join("cmdline")).unwrap_or_default();
            command.split(|b| *b == 0).any(|a| a == marker.as_bytes())
        });
        assert_eq!(left.count(), 0, "children are gone too");
    }
}
