//! Files that are whole under their name, or not there at all, however the process ends.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The files that are being written. Clones share one list.
#[derive(Clone, Debug, Default)]
pub struct Files {
    unfinished: Arc<Mutex<BTreeSet<PathBuf>>>,
}

/// A file that does not have its name yet; dropped unfinished, it is gone.
#[derive(Debug)]
pub struct Unfinished {
    files: Files,
    temporary: PathBuf,
    path: PathBuf,
}

impl Files {
    /// Begins the file `path` beside it, under a name of this process.
    ///
    /// # Errors
    /// `path` is a folder, it is begun already, or the temporary file cannot be created.
    pub fn begin(&self, path: &Path) -> io::Result<(File, Unfinished)> {
        let name = path.file_name().filter(|_| !path.is_dir()).ok_or(io::ErrorKind::IsADirectory)?;
        let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
        let name = format!(".{}.{}.part", name.to_string_lossy(), std::process::id());
        // One name for each, however its path is written.
        let temporary = folder.canonicalize()?.join(name);
        let mut unfinished = self.list();
        if unfinished.contains(&temporary) {
            return Err(io::Error::other("another option writes this file too: give each a file of its own"));
        }
        let file = File::create(&temporary)?;
        unfinished.insert(temporary.clone());
        Ok((file, Unfinished { files: self.clone(), temporary, path: path.to_owned() }))
    }

    /// Writes a whole file, in place of one of that name.
    ///
    /// # Errors
    /// It cannot be written; one of that name is then as it was.
    pub fn write(&self, path: &Path, contents: &[u8]) -> io::Result<()> {
        let (mut file, unfinished) = self.begin(path)?;
        file.write_all(contents)?;
        unfinished.finish()
    }

    /// Removes what is unfinished. While the guard lives, no file begins or ends.
    #[must_use = "files can begin and end again once it is dropped"]
    pub fn abandon(&self) -> MutexGuard<'_, BTreeSet<PathBuf>> {
        let mut unfinished = self.list();
        for temporary in std::mem::take(&mut *unfinished) {
            // What cannot be removed now never will be.
            let _ = fs::remove_file(temporary);
        }
        unfinished
    }

    fn list(&self) -> MutexGuard<'_, BTreeSet<PathBuf>> {
        self.unfinished.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Unfinished {
    /// Gives the file its name; all of it must have been flushed.
    ///
    /// # Errors
    /// It cannot be renamed.
    pub fn finish(self) -> io::Result<()> {
        let mut unfinished = self.files.list();
        fs::rename(&self.temporary, &self.path)?;
        unfinished.remove(&self.temporary);
        Ok(())
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        if self.files.list().remove(&self.temporary) {
            let _ = fs::remove_file(&self.temporary);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_file_has_its_name_only_when_it_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let (files, path) = (Files::default(), folder.path().join("a.json"));
        let (mut file, unfinished) = files.begin(&path).unwrap();
        file.write_all(b"{}").unwrap();
        assert!(!path.exists());
        unfinished.finish().unwrap();
        assert_eq!(names(folder.path()), ["a.json"]);
        files.write(&path, b"[]").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"[]");
        assert_eq!(names(folder.path()), ["a.json"]);
    }

    #[test]
    fn a_folder_and_a_file_that_is_begun_already_are_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let (files, path) = (Files::default(), folder.path().join("a"));
        assert_eq!(files.begin(folder.path()).unwrap_err().kind(), io::ErrorKind::IsADirectory);
        let (_file, unfinished) = files.begin(&path).unwrap();
        assert!(files.begin(&folder.path().join("./a")).unwrap_err().to_string().contains("a file of its own"));
        unfinished.finish().unwrap();
        assert_eq!(names(folder.path()), ["a"]);
        drop(files.begin(&path).unwrap());
    }

    #[test]
    fn what_is_dropped_or_abandoned_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let files = Files::default();
        drop(files.begin(&folder.path().join("a")).unwrap());
        let (_file, unfinished) = files.begin(&folder.path().join("b")).unwrap();
        drop(files.abandon());
        assert!(names(folder.path()).is_empty());
        assert!(unfinished.finish().is_err());
    }
}
