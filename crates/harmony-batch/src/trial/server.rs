//! A PostgreSQL server of our own, in a folder of our own, that can be killed.

use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

/// A running cluster; it ends when dropped.
pub struct Server {
    folder: PathBuf,
    bin: PathBuf,
    port: u16,
}

/// Where PostgreSQL's programs are; `None` when there are none.
fn programs() -> Option<PathBuf> {
    let mut found: Vec<PathBuf> = std::fs::read_dir("/usr/lib/postgresql")
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path().join("bin"))
        .collect();
    found.sort();
    found.reverse();
    found.extend(std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default()));
    found.into_iter().find(|folder| folder.join("initdb").is_file() && folder.join("postgres").is_file())
}

fn is_root() -> bool {
    rustix::process::geteuid().is_root()
}

/// A command as the server's user: PostgreSQL refuses to be root.
fn as_server(program: &Path) -> Command {
    if is_root() {
        let mut command = Command::new("runuser");
        command.args(["-u", "postgres", "--"]).arg(program);
        command
    } else {
        Command::new(program)
    }
}

fn run(mut command: Command) -> Result<(), String> {
    let said = command.stdin(Stdio::null()).output().map_err(|e| format!("{command:?}: {e}"))?;
    if said.status.success() {
        return Ok(());
    }
    Err(format!("{command:?}: {} {}", String::from_utf8_lossy(&said.stdout), String::from_utf8_lossy(&said.stderr)))
}

impl Server {
    /// Makes and starts one; `None` when PostgreSQL is not installed.
    pub fn start(folder: &Path) -> Result<Option<Self>, String> {
        let Some(bin) = programs() else { return Ok(None) };
        let data = folder.join("postgres");
        std::fs::create_dir_all(&data).map_err(|e| e.to_string())?;
        if is_root() {
            // The way there must be open to the server's user.
            use std::os::unix::fs::PermissionsExt as _;
            std::fs::set_permissions(folder, std::fs::Permissions::from_mode(0o755)).map_err(|e| e.to_string())?;
            let mut chown = Command::new("chown");
            chown.arg("postgres").arg(&data);
            run(chown)?;
        }
        let mut make = as_server(&bin.join("initdb"));
        make.arg("-D").arg(&data).args(["-A", "trust", "-U", "harmony", "-E", "UTF8", "--no-sync"]);
        run(make)?;
        let port = TcpListener::bind(("127.0.0.1", 0)).and_then(|l| l.local_addr()).map_err(|e| e.to_string())?.port();
        let server = Self { folder: data, bin, port };
        server.up()?;
        Ok(Some(server))
    }

    /// Starts it (again).
    pub fn up(&self) -> Result<(), String> {
        let begun = Instant::now();
        loop {
            let mut start = as_server(&self.bin.join("pg_ctl"));
            let options = format!("-p {} -h 127.0.0.1 -k {} -c max_connections=200", self.port, self.folder.display());
            start
                .arg("-D")
                .arg(&self.folder)
                .arg("-l")
                .arg(self.folder.join("log"))
                .args(["-w", "-o", &options, "start"]);
            match run(start) {
                Ok(()) => return Ok(()),
                // Processes of the one that was killed are still ending.
                Err(_) if begun.elapsed() < Duration::from_secs(40) => std::thread::sleep(Duration::from_millis(300)),
                Err(error) => return Err(error),
            }
        }
    }

    /// Kills it: the first process with SIGKILL, as the kernel's memory killer does, or all at once.
    pub fn kill(&self, all: bool) -> Result<(), String> {
        if all {
            let mut stop = as_server(&self.bin.join("pg_ctl"));
            stop.arg("-D").arg(&self.folder).args(["-m", "immediate", "-w", "stop"]);
            return run(stop);
        }
        let text = std::fs::read_to_string(self.folder.join("postmaster.pid")).map_err(|e| e.to_string())?;
        let pid: i32 = text.lines().next().unwrap_or_default().trim().parse().map_err(|_| "no process id")?;
        kill_process(Pid::from_raw(pid).ok_or("no process id")?, Signal::KILL).map_err(|e| e.to_string())
    }

    /// Its address.
    pub fn address(&self) -> String {
        format!("postgres://harmony@127.0.0.1:{}/postgres", self.port)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.kill(true);
    }
}
