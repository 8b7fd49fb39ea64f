//! The flight recorder: one file a flight, written by its own thread behind a bounded queue.
//!
//! The caller never waits, neither for a record nor for the file: a full queue drops the record and counts it, and the
//! thread makes the file itself. A disk error ends the recording and is kept for [`Recorder::failure`]; the process lives
//! on. Each second the chunk is ended and synced, so a power cut costs at most one second.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, ErrorKind, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
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

/// A flight log that is being written.
pub struct Recorder {
    path: PathBuf,
    sender: Option<SyncSender<Record>>,
    thread: Option<JoinHandle<()>>,
    opened: Arc<AtomicBool>,
    failure: Arc<Mutex<Option<String>>>,
    dropped: Arc<AtomicU64>,
}

impl Recorder {
    /// Has the thread do `first`, and make the file, and its folder where needed. Never overwrites. What is recorded
    /// meanwhile waits; a file that cannot be made is a [`Self::failure`].
    ///
    /// # Errors
    /// The thread could not be started.
    pub fn begin(path: &Path, first: impl FnOnce() + Send + 'static) -> Result<Self, RecorderError> {
        let file = path.to_owned();
        Self::on_thread(path, move || {
            first();
            create(&file)
        })
    }

    /// A recorder over any sink; `path` is only its name.
    ///
    /// # Errors
    /// The thread could not be started.
    pub fn over<W>(sink: W, sync: Sync, path: &Path) -> Result<Self, RecorderError>
    where
        W: Write + Send + 'static,
    {
        Self::on_thread(path, move || Ok((sink, sync)))
    }

    fn on_thread<W, F>(path: &Path, open: F) -> Result<Self, RecorderError>
    where
        W: Write,
        F: FnOnce() -> Result<(W, Sync), RecorderError> + Send + 'static,
    {
        let (sender, receiver) = sync_channel(QUEUE);
        let failure = Arc::new(Mutex::new(None));
        let dropped = Arc::new(AtomicU64::new(0));
        let opened = Arc::new(AtomicBool::new(false));
        let (told, unmade, open_now) = (Arc::clone(&failure), Arc::clone(&dropped), Arc::clone(&opened));
        let work = move || {
            let (sink, sync) = open().map_err(|e| e.to_string())?;
            open_now.store(true, Ordering::Relaxed);
            write_all(sink, sync, &receiver, &unmade).map_err(|e| chain(&e))
        };
        let thread = thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || {
                let done = catch_unwind(AssertUnwindSafe(work));
                if let Err(why) = done.unwrap_or_else(|_| Err(PANICKED.to_owned())) {
                    tracing::error!("recording stopped: {why}");
                    *told.lock().unwrap_or_else(PoisonError::into_inner) = Some(why);
                }
            })
            .map_err(RecorderError::Thread)?;
        Ok(Recorder { path: path.to_owned(), sender: Some(sender), thread: Some(thread), opened, failure, dropped })
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

    /// The file is there: before, and if it could not be made, it is not.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.opened.load(Ordering::Relaxed)
    }

    /// Records dropped so far.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    /// Why the recording ended early; none while all is well.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Has the thread write what is queued and the summary, and waits for neither; see [`Self::is_finished`].
    pub fn finish(&mut self) {
        self.sender = None;
    }

    /// Nothing is left to be written.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Writes what is queued and the summary, and waits for it. Also done on drop.
    pub fn close(&mut self) {
        self.finish();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // what it failed of, it told
        }
    }

    /// As [`Self::close`], but waits no longer than this: a thread that the disk does not let go of is left to itself.
    /// False: it was.
    pub fn close_within(&mut self, time: Duration) -> bool {
        self.finish();
        let begun = Instant::now();
        while !self.is_finished() && begun.elapsed() < time {
            thread::sleep(Duration::from_millis(5));
        }
        let finished = self.is_finished();
        if finished {
            self.close();
        }
        self.thread = None;
        finished
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.close();
    }
}

/// Makes the file, and its folder where needed; and what brings it to the disk.
fn create(path: &Path) -> Result<(BufWriter<File>, Sync), RecorderError> {
    let error = |source| RecorderError::Create { path: path.to_owned(), source };
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(error)?;
    let file = OpenOptions::new().write(true).create_new(true).open(path).map_err(|source| {
        if source.kind() == ErrorKind::AlreadyExists { RecorderError::Exists(path.to_owned()) } else { error(source) }
    })?;
    // The file's name must survive a power cut as well; a folder that cannot be synced is no reason not to record.
    let _ = File::open(folder).and_then(|folder| folder.sync_all());
    let disk = file.try_clone().map_err(error)?;
    Ok((BufWriter::new(file), Box::new(move || disk.sync_data())))
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
