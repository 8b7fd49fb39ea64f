//! The flight recorder: one file a flight, written by its own thread behind a bounded queue.
//!
//! The caller never waits: a full queue drops the record and counts it. A disk error ends the recording and is kept
//! for [`Recorder::failure`]; the process lives on. Each second the chunk is ended and synced, so a power cut costs at
//! most one second.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use crate::channel::Channel;
use crate::error::RecorderError;
use crate::writer::LogWriter;

/// Records that may wait for the disk. Chosen by eye.
const QUEUE: usize = 1024;
const PANICKED: &str = "the recorder's thread panicked";
/// What is recorded is on the disk after this, so that a power cut costs a second at most.
const SYNC_PERIOD: Duration = Duration::from_millis(500);

/// Makes a record's bytes; runs on the recorder's thread, so that compression costs the caller nothing. None: it could
/// not be made, and counts as dropped.
pub type Payload = Box<dyn FnOnce() -> Option<Vec<u8>> + Send>;

struct Record {
    channel: Channel,
    time_ns: u64,
    payload: Payload,
}

/// Blocks until all that the sink was given is on the disk.
pub type Sync = Box<dyn FnMut() -> std::io::Result<()> + Send>;

/// An open flight log.
pub struct Recorder {
    path: PathBuf,
    sender: Option<SyncSender<Record>>,
    thread: Option<JoinHandle<()>>,
    failure: Arc<Mutex<Option<String>>>,
    dropped: Arc<AtomicU64>,
}

impl Recorder {
    /// Creates the file, and its folder where needed. Never overwrites.
    ///
    /// # Errors
    /// The file exists or cannot be made.
    pub fn create(path: &Path) -> Result<Self, RecorderError> {
        let error = |source| RecorderError::Create { path: path.to_owned(), source };
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder).map_err(error)?;
        let file = OpenOptions::new().write(true).create_new(true).open(path).map_err(|source| {
            if source.kind() == ErrorKind::AlreadyExists {
                RecorderError::Exists(path.to_owned())
            } else {
                error(source)
            }
        })?;
        // The file's name must survive a power cut as well; a folder that cannot be synced is no reason not to record.
        let _ = File::open(folder).and_then(|folder| folder.sync_all());
        let disk = file.try_clone().map_err(error)?;
        Self::over(BufWriter::new(file), Box::new(move || disk.sync_data()), path)
    }

    /// A recorder over any sink; `path` is only its name.
    ///
    /// # Errors
    /// The thread could not be started.
    pub fn over<W>(sink: W, sync: Sync, path: &Path) -> Result<Self, RecorderError>
    where
        W: Write + Send + 'static,
    {
        let (sender, receiver) = sync_channel(QUEUE);
        let failure = Arc::new(Mutex::new(None));
        let dropped = Arc::new(AtomicU64::new(0));
        let (told, unmade) = (Arc::clone(&failure), Arc::clone(&dropped));
        let thread = thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || {
                if let Err(e) = write_all(sink, sync, &receiver, &unmade) {
                    let why = chain(&e);
                    tracing::error!("recording stopped: {why}");
                    *told.lock().unwrap_or_else(PoisonError::into_inner) = Some(why);
                }
            })
            .map_err(RecorderError::Thread)?;
        Ok(Recorder { path: path.to_owned(), sender: Some(sender), thread: Some(thread), failure, dropped })
    }

    /// Queues a record; `payload` runs on the recorder's thread. Never blocks: with the queue full or the recording
    /// ended by an error, the record is dropped and counted.
    pub fn record(&self, channel: Channel, time_ns: u64, payload: Payload) {
        let Some(sender) = &self.sender else { return };
        if let Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) =
            sender.try_send(Record { channel, time_ns, payload })
        {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Records dropped so far.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    /// Why the recording ended early; none while all is well.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        let told = self.failure.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let ended = self.sender.is_some() && self.thread.as_ref().is_some_and(JoinHandle::is_finished);
        told.or_else(|| ended.then(|| PANICKED.to_owned()))
    }

    /// Writes what is queued and the summary, and waits for it. Also done on drop.
    pub fn close(&mut self) {
        self.sender = None;
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            *self.failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(PANICKED.to_owned());
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.close();
    }
}

fn write_all<W: Write>(
    sink: W,
    mut sync: Sync,
    records: &Receiver<Record>,
    unmade: &AtomicU64,
) -> Result<(), mcap::McapError> {
    let mut log = LogWriter::new(sink)?;
    let mut synced = Instant::now();
    loop {
        match records.recv_timeout(SYNC_PERIOD) {
            Ok(Record { channel, time_ns, payload }) => match payload() {
                Some(bytes) => log.write(channel, time_ns, &bytes)?,
                None => {
                    unmade.fetch_add(1, Ordering::Relaxed);
                }
            },
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        if synced.elapsed() >= SYNC_PERIOD {
            synced = Instant::now();
            log.flush()?;
            sync()?;
        }
    }
    log.finish()?.flush()?;
    sync()?;
    Ok(())
}

// An error with its causes, in one line: the system's own words come last.
fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text = format!("{text}: {error}");
        cause = error.source();
    }
    text
}
