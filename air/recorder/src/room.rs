//! Whether the logs' disk takes a log again.

use std::fs::{File, remove_file};
use std::io::Write;
use std::path::Path;

/// What must fit before a recording is worth beginning: some seconds of a flight.
const NEEDED: usize = 8 << 20;

/// Writes as much to `folder` as a log's first seconds need, and removes it again. The only sure test: quotas, limits and
/// a disk that lost its cable show in no count of free bytes. It waits for the disk, so it is for the ground.
///
/// # Errors
/// Why no log can be written.
pub fn has_room(folder: &Path) -> Result<(), String> {
    let probe = folder.join(".room");
    let written = std::fs::create_dir_all(folder).and_then(|()| File::create(&probe)).and_then(|mut file| {
        let block = vec![0x5A; 1 << 20];
        (0..NEEDED / block.len()).try_for_each(|_| file.write_all(&block))?;
        file.sync_all()
    });
    let removed = remove_file(&probe);
    written.and(removed).map_err(|e| format!("no log can be written to {}: {e}; free some space", folder.display()))
}
