//! Finds the ONNX Runtime library, which is loaded when the first policy is.
//!
//! The PyPI wheel `onnxruntime` carries it, so the project's virtual environment is enough.

use std::path::{Path, PathBuf};

/// Why no library was found.
#[derive(Debug, thiserror::Error)]
pub enum LibraryError {
    /// The configured path holds none.
    #[error("{0}: no ONNX Runtime library there (libonnxruntime.so*); correct the configured path or leave it out")]
    Configured(PathBuf),
    /// No usual place has one.
    #[error(
        "no ONNX Runtime library found (libonnxruntime.so*): run `make setup`, or install the Python package \
         onnxruntime into a .venv, or configure the library's path; looked in {}", list(.0)
    )]
    Nowhere(Vec<PathBuf>),
}

fn list(paths: &[PathBuf]) -> String {
    paths.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
}

/// Where to look; all of it an argument.
#[derive(Clone, Debug, Default)]
pub struct Places {
    /// The running program's file.
    pub executable: Option<PathBuf>,
    /// The current directory.
    pub current_dir: Option<PathBuf>,
    /// The active virtual environment.
    pub virtual_env: Option<PathBuf>,
}

impl Places {
    /// This process's.
    #[must_use]
    pub fn of_process() -> Self {
        Self {
            executable: std::env::current_exe().ok(),
            current_dir: std::env::current_dir().ok(),
            virtual_env: std::env::var_os("VIRTUAL_ENV").map(PathBuf::from),
        }
    }

    /// Directories that may hold the library, the best first.
    fn directories(&self) -> Vec<PathBuf> {
        let beside = self.executable.as_deref().and_then(Path::parent);
        let mut directories: Vec<PathBuf> = beside.map(Path::to_path_buf).into_iter().collect();
        let above = |path: Option<&Path>| -> Vec<PathBuf> {
            path.into_iter().flat_map(Path::ancestors).map(|ancestor| ancestor.join(".venv")).collect()
        };
        let environments =
            self.virtual_env.iter().cloned().chain(above(self.current_dir.as_deref())).chain(above(beside));
        for environment in environments {
            for directory in wheel_directories(&environment) {
                if !directories.contains(&directory) {
                    directories.push(directory);
                }
            }
        }
        directories
    }
}

/// `<venv>/lib/python*/site-packages/onnxruntime/capi` of an existing environment.
fn wheel_directories(environment: &Path) -> Vec<PathBuf> {
    let versions = entries(&environment.join("lib"), |name| name.starts_with("python"));
    versions.into_iter().map(|version| version.join("site-packages/onnxruntime/capi")).collect()
}

/// Entries of a directory whose name passes, sorted; none if it cannot be read.
fn entries(directory: &Path, passes: impl Fn(&str) -> bool) -> Vec<PathBuf> {
    let Ok(read) = std::fs::read_dir(directory) else { return Vec::new() };
    let mut found: Vec<PathBuf> =
        read.flatten().filter(|entry| passes(&entry.file_name().to_string_lossy())).map(|entry| entry.path()).collect();
    found.sort();
    found
}

fn is_library(name: &str) -> bool {
    name.starts_with("libonnxruntime.") && (name.contains(".so") || name.ends_with(".dylib"))
}

fn library_in(directory: &Path) -> Option<PathBuf> {
    entries(directory, is_library).pop()
}

/// The library's file.
///
/// `configured` is a file or a directory that holds it; absent: beside the program, in the active virtual environment,
/// in a `.venv` of the current directory or of the program's, or of any directory above these.
///
/// # Errors
/// None there; the message lists where it looked.
pub fn find(configured: Option<&Path>, places: &Places) -> Result<PathBuf, LibraryError> {
    if let Some(path) = configured {
        let found = if path.is_dir() { library_in(path) } else { path.is_file().then(|| path.to_path_buf()) };
        return found.ok_or_else(|| LibraryError::Configured(path.to_path_buf()));
    }
    let directories = places.directories();
    directories.iter().find_map(|directory| library_in(directory)).ok_or(LibraryError::Nowhere(directories))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wheel(root: &Path) -> PathBuf {
        let directory = root.join(".venv/lib/python3.11/site-packages/onnxruntime/capi");
        std::fs::create_dir_all(&directory).unwrap();
        std::fs::write(directory.join("libonnxruntime_providers_shared.so"), "").unwrap();
        let library = directory.join("libonnxruntime.so.1.31.1");
        std::fs::write(&library, "").unwrap();
        library
    }

    #[test]
    fn a_venv_above_the_current_directory_is_found() {
        let root = tempfile::tempdir().unwrap();
        let library = wheel(root.path());
        let places = Places { current_dir: Some(root.path().join("a/b")), ..Places::default() };
        assert_eq!(find(None, &places).unwrap(), library);
    }

    #[test]
    fn a_venv_above_the_program_is_found() {
        let root = tempfile::tempdir().unwrap();
        let library = wheel(root.path());
        let places = Places { executable: Some(root.path().join("target/release/goshawk-air")), ..Places::default() };
        assert_eq!(find(None, &places).unwrap(), library);
    }

    #[test]
    fn the_active_environment_wins_over_a_venv_above() {
        let (root, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        wheel(root.path());
        let active = wheel(other.path());
        let places = Places {
            current_dir: Some(root.path().to_path_buf()),
            virtual_env: Some(other.path().join(".venv")),
            executable: None,
        };
        assert_eq!(find(None, &places).unwrap(), active);
    }

    #[test]
    fn a_library_beside_the_program_wins() {
        let root = tempfile::tempdir().unwrap();
        wheel(root.path());
        let beside = root.path().join("libonnxruntime.so");
        std::fs::write(&beside, "").unwrap();
        let places = Places {
            executable: Some(root.path().join("goshawk-air")),
            current_dir: Some(root.path().to_path_buf()),
            virtual_env: None,
        };
        assert_eq!(find(None, &places).unwrap(), beside);
    }

    #[test]
    fn a_configured_file_or_directory_is_taken_and_nothing_else() {
        let root = tempfile::tempdir().unwrap();
        let library = wheel(root.path());
        assert_eq!(find(Some(&library), &Places::default()).unwrap(), library);
        assert_eq!(find(library.parent(), &Places::default()).unwrap(), library);
        let places = Places { current_dir: Some(root.path().to_path_buf()), ..Places::default() };
        let missing = root.path().join("missing.so");
        assert!(find(Some(&missing), &places).unwrap_err().to_string().contains("missing.so"));
    }

    #[test]
    fn nothing_found_says_where_it_looked_and_what_to_do() {
        let root = tempfile::tempdir().unwrap();
        let capi = root.path().join(".venv/lib/python3.11/site-packages/onnxruntime/capi");
        std::fs::create_dir_all(root.path().join(".venv/lib/python3.11")).unwrap();
        let places = Places { current_dir: Some(root.path().to_path_buf()), ..Places::default() };
        let message = find(None, &places).unwrap_err().to_string();
        assert!(message.contains(&capi.display().to_string()), "{message}");
        assert!(message.contains("make setup"));
    }
}
