//! Starts firmware that somebody has built, with the parameters of the simulated airframe, and ends it.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use tempfile::TempDir;
use thiserror::Error;

const PX4_PARAMETERS: &str = include_str!("../../../firmware/px4.params");
const ARDUPILOT_PARAMETERS: &str = include_str!("../../../firmware/ardupilot.parm");
/// PX4's airframe for a simulator that dials nobody.
const PX4_MODEL: &str = "none_iris";
/// Where builds leave the program, below the folder that is given.
const PX4_PROGRAMS: [&str; 2] = ["bin/px4", "build/px4_sitl_default/bin/px4"];
const ARDUPILOT_PROGRAMS: [&str; 3] = ["arducopter", "bin/arducopter", "build/sitl/bin/arducopter"];

/// Why firmware cannot be started.
#[derive(Debug, Error)]
pub enum ProcessError {
    /// There is no such build.
    #[error("no {what} is built in {folder}: looked for {looked}; build it there, or name the folder of a build")]
    Missing {
        /// Which firmware.
        what: &'static str,
        /// The folder that was named.
        folder: PathBuf,
        /// Where it was looked for.
        looked: String,
    },
    /// It does not start.
    #[error("cannot start {program}: {source}")]
    Start {
        /// The program, or the file beside it.
        program: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// Running firmware; it ends with this value, or with [`Process::end_all`], and its folder goes.
#[derive(Debug)]
pub struct Process(Arc<Mutex<Option<Running>>>);

#[derive(Debug)]
struct Running {
    child: Child,
    folder: TempDir,
}

/// All that runs, for whoever leaves without destructors.
static ALL: Mutex<Vec<Weak<Mutex<Option<Running>>>>> = Mutex::new(Vec::new());

impl Process {
    /// PX4 out of a source tree or a build folder, as the `instance`-th on this computer.
    ///
    /// # Errors
    /// There is none, or it does not start.
    pub fn px4(tree: &Path, instance: u16) -> Result<Self, ProcessError> {
        let program = Self::px4_program(tree)?;
        let build = program.ancestors().nth(2).unwrap_or(tree).to_owned();
        let mut script = format!(". {}\n", build.join("etc/init.d-posix/rcS").display());
        for (name, value) in parameters(PX4_PARAMETERS) {
            script += &format!("param set {name} {value}\n");
        }
        Self::start(&program, "start.sh", &script, |command, file| {
            command.args(["-d", "-i", &instance.to_string(), "-s"]).arg(file).arg(build.join("etc"));
            command.env("PX4_SIM_MODEL", PX4_MODEL);
        })
    }

    /// `ArduPilot`'s Copter out of a source tree or a build folder, as the `instance`-th on this computer.
    ///
    /// # Errors
    /// There is none, or it does not start.
    pub fn ardupilot(tree: &Path, instance: u16) -> Result<Self, ProcessError> {
        let program = Self::ardupilot_program(tree)?;
        Self::start(&program, "copter.parm", ARDUPILOT_PARAMETERS, |command, file| {
            command.args(["--model", "JSON:127.0.0.1", "--speedup", "1", "--instance", &instance.to_string()]);
            command.arg("--defaults").arg(file);
        })
    }

    /// PX4's program in a source tree or a build folder.
    ///
    /// # Errors
    /// There is none.
    pub fn px4_program(tree: &Path) -> Result<PathBuf, ProcessError> {
        find("PX4", tree, &PX4_PROGRAMS)
    }

    /// `ArduPilot` Copter's program in a source tree or a build folder.
    ///
    /// # Errors
    /// There is none.
    pub fn ardupilot_program(tree: &Path) -> Result<PathBuf, ProcessError> {
        find("ArduPilot Copter", tree, &ARDUPILOT_PROGRAMS)
    }

    /// Runs `program` in a folder of its own, with one file there.
    fn start(
        program: &Path,
        name: &str,
        content: &str,
        arrange: impl FnOnce(&mut Command, &Path),
    ) -> Result<Self, ProcessError> {
        let failed = |source| ProcessError::Start { program: program.to_owned(), source };
        let folder = tempfile::Builder::new().prefix("goshawk-firmware-").tempdir().map_err(failed)?;
        let file = folder.path().join(name);
        fs::write(&file, content).map_err(failed)?;
        let output = File::create(folder.path().join("output.txt")).map_err(failed)?;
        let errors = output.try_clone().map_err(failed)?;
        let mut command = Command::new(program);
        arrange(&mut command, &file);
        command.current_dir(folder.path()).stdin(Stdio::null()).stdout(output).stderr(errors);
        let child = command.spawn().map_err(failed)?;
        let running = Arc::new(Mutex::new(Some(Running { child, folder })));
        let mut all = lock(&ALL);
        all.retain(|one| one.strong_count() > 0);
        all.push(Arc::downgrade(&running));
        Ok(Self(running))
    }

    /// Ends all firmware of this process.
    pub fn end_all() {
        end(lock(&ALL).drain(..));
    }

    /// How it ended by itself; none: it runs.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        lock(&self.0).as_mut()?.child.try_wait().ok().flatten()
    }

    /// The last lines that it printed.
    #[must_use]
    pub fn last_words(&self) -> String {
        let output = lock(&self.0).as_ref().map(|running| running.folder.path().join("output.txt"));
        let text = output.and_then(|output| fs::read(output).ok()).unwrap_or_default();
        let text = String::from_utf8_lossy(&text).into_owned();
        let lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty()).collect();
        lines[lines.len().saturating_sub(3)..].join(" | ")
    }
}

fn end(all: impl Iterator<Item = Weak<Mutex<Option<Running>>>>) {
    for running in all.filter_map(|one| one.upgrade()) {
        drop(lock(&running).take());
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The program of a build, with its whole path.
fn find(what: &'static str, folder: &Path, places: &[&str]) -> Result<PathBuf, ProcessError> {
    places
        .iter()
        .find_map(|place| folder.join(place).canonicalize().ok().filter(|path| path.is_file()))
        .ok_or_else(|| ProcessError::Missing { what, folder: folder.to_owned(), looked: places.join(", ") })
}

/// Names and values of a parameter file.
fn parameters(text: &str) -> impl Iterator<Item = (&str, &str)> {
    text.lines().filter(|line| !line.starts_with('#')).filter_map(|line| line.split_once(' '))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn a_parameter_file_is_read_without_its_comments() {
        let all: Vec<_> = parameters(PX4_PARAMETERS).collect();
        assert!(all.contains(&("MPC_THR_HOVER", "0.35")), "{all:?}");
        assert!(all.iter().all(|(_, value)| value.parse::<f64>().is_ok()), "{all:?}");
    }

    #[test]
    fn what_is_not_built_is_named_with_the_places_that_were_looked_at() {
        let folder = tempfile::tempdir().unwrap();
        let told = Process::px4(folder.path(), 0).unwrap_err().to_string();
        assert!(told.contains("no PX4 is built") && told.contains("bin/px4"), "{told}");
    }

    #[test]
    fn a_program_that_ends_at_once_is_heard_to_its_last_words() {
        let folder = tempfile::tempdir().unwrap();
        let program = folder.path().join("arducopter");
        fs::write(&program, "#!/bin/sh\necho no such frame\nexit 3\n").unwrap();
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
        let mut process = Process::ardupilot(folder.path(), 0).unwrap();
        let ended = loop {
            if let Some(status) = process.ended() {
                break status;
            }
            std::thread::sleep(std::time::Duration::from_millis(5));
        };
        assert_eq!(ended.code(), Some(3));
        assert_eq!(process.last_words(), "no such frame");
    }

    #[test]
    fn who_leaves_without_destructors_can_end_all_firmware_and_its_folders() {
        let folder = tempfile::tempdir().unwrap();
        let program = folder.path().join("arducopter");
        fs::write(&program, "#!/bin/sh\nexec sleep 600\n").unwrap();
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
        let process = Process::ardupilot(folder.path(), 0).unwrap();
        let (pid, own) = {
            let running = lock(&process.0);
            let running = running.as_ref().unwrap();
            (running.child.id(), running.folder.path().to_owned())
        };
        let runs = || Path::new(&format!("/proc/{pid}")).exists();
        assert!(runs() && own.is_dir());
        let known = Arc::downgrade(&process.0);
        assert!(lock(&ALL).iter().any(|one| one.ptr_eq(&known)));
        // Not all: beside this one run other tests' programs.
        end([known].into_iter());
        assert!(!runs() && !own.exists());
    }
}
