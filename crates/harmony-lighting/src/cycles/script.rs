//! Other work for the same Blender: a script and a job of the caller's, under the same watch as a render.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use super::{BlenderKind, CyclesRenderer, LitError, run};

impl CyclesRenderer {
    /// Runs a Python script in Blender with a job file as its last argument, in a folder of the caller's, and waits.
    ///
    /// Script and job are written to that folder as `script.py` and `job.json`. Returns the end of what Blender said.
    ///
    /// # Errors
    /// [`LitError::Io`], [`LitError::Timeout`], [`LitError::Failed`] with the end of its log.
    pub fn run_script(
        &self,
        script: &str,
        job: &serde_json::Value,
        folder: &Path,
        limit: Duration,
    ) -> Result<String, LitError> {
        let io = |what: &'static str| move |source| LitError::Io { what, source };
        let (script_file, job_file) = (folder.join("script.py"), folder.join("job.json"));
        std::fs::write(&script_file, script).map_err(io("write Blender's script"))?;
        std::fs::write(&job_file, job.to_string()).map_err(io("write Blender's job"))?;
        let mut command = Command::new(&self.program);
        match self.kind {
            BlenderKind::Module => command.arg(&script_file),
            BlenderKind::Program => {
                command.args(["--background", "--factory-startup", "--python-exit-code", "9", "--python"]);
                command.arg(&script_file).arg("--")
            }
        };
        command.arg(&job_file).current_dir(folder).env("PYTHONDONTWRITEBYTECODE", "1");
        let (status, tail) = run::run(command, limit, &mut |_| {})?;
        if status.success() { Ok(tail) } else { Err(LitError::Failed { status: status.to_string(), log_tail: tail }) }
    }
}
