//! Lines that carry a stream of bytes, serial ports and TCP: opened, read, written without waiting, and opened again
//! when they break.

use crate::wire::address::Address;
use crate::wire::error::AutopilotError;
use goshawk_core::Time;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::net::sockopt::set_socket_send_buffer_size;
use rustix::termios::{ControlModes, OptionalActions, ioctl_tiocexcl, tcgetattr, tcsetattr};
use std::io::{Error, ErrorKind};
use std::net::{SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::os::fd::OwnedFd;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::Duration;

/// How long a look for bytes takes at most.
const WAIT: Duration = Duration::from_millis(5);
/// Before a broken line is opened again, s: at first. Chosen by eye.
const FIRST_RETRY_S: f64 = 0.1;
/// And at most, s. Chosen by eye.
const LAST_RETRY_S: f64 = 2.0;
/// How long a TCP peer may take to answer a call. Nothing else is to be done meanwhile. Chosen by eye.
const CONNECT_WITHIN: Duration = Duration::from_secs(1);
/// A TCP connection on which nothing came for so long is dead, whatever the system believes: five heartbeats.
const TCP_SILENCE_S: f64 = 5.0;
/// Bytes that may wait in a TCP connection that does not move: old setpoints help nobody.
const TCP_WAITING: usize = 16_384;
/// Bytes read at once.
const READ: usize = 4096;

/// One line, as all threads share it.
pub(crate) struct Line {
    address: Address,
    listener: Option<TcpListener>,
    out: Mutex<Option<Outgoing>>,
    problem: Mutex<Option<String>>,
}

struct Outgoing {
    port: Arc<OwnedFd>,
    /// The end of a frame of which the line took the beginning.
    rest: Vec<u8>,
}

impl Line {
    /// A line that is not open yet; one that listens does so from now on.
    pub(crate) fn new(address: &Address) -> Result<Self, AutopilotError> {
        let listener = match address {
            Address::TcpIn(local) => Some(listen(*local).map_err(|source| match source.kind() {
                ErrorKind::AddrInUse => AutopilotError::PortInUse(address.clone()),
                _ => AutopilotError::Bind { address: address.clone(), source },
            })?),
            _ => None,
        };
        let problem = Mutex::new(Some(format!("{address} is not open yet")));
        Ok(Self { address: address.clone(), listener, out: Mutex::new(None), problem })
    }

    /// Where it listens; none: it does not.
    pub(crate) fn local_address(&self) -> Option<SocketAddr> {
        self.listener.as_ref().and_then(|listener| listener.local_addr().ok())
    }

    /// Why it is not open; none: it is.
    pub(crate) fn problem(&self) -> Option<String> {
        lock(&self.problem).clone()
    }

    /// Writes one frame, whole or not at all. Never waits for the line; `hurried`: nor for another thread that writes.
    pub(crate) fn send(&self, frame: &[u8], hurried: bool) -> std::io::Result<()> {
        let mut guard = if hurried {
            match self.out.try_lock() {
                Ok(guard) => guard,
                Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
                Err(TryLockError::WouldBlock) => return Err(ErrorKind::WouldBlock.into()),
            }
        } else {
            lock(&self.out)
        };
        let out = guard.as_mut().ok_or(Error::from(ErrorKind::NotConnected))?;
        while !out.rest.is_empty() {
            let written = rustix::io::write(&out.port, &out.rest)?;
            out.rest.drain(..written);
        }
        let written = rustix::io::write(&out.port, frame)?;
        out.rest.extend_from_slice(&frame[written..]);
        Ok(())
    }

    fn open(&self) -> std::io::Result<Option<OwnedFd>> {
        match &self.address {
            Address::Serial { device, baud } => open_serial(device, *baud).map(Some),
            Address::TcpOut(peer) => connect(peer).and_then(prepare).map(Some),
            _ => match self.listener.as_ref().map(TcpListener::accept) {
                Some(Ok((stream, _))) => prepare(stream).map(Some),
                Some(Err(error)) if error.kind() != ErrorKind::WouldBlock => Err(error),
                _ => Ok(None),
            },
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Every change is complete in itself.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn listen(local: SocketAddr) -> std::io::Result<TcpListener> {
    let listener = TcpListener::bind(local)?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}

fn connect(peer: &str) -> std::io::Result<TcpStream> {
    let mut last = Error::new(ErrorKind::NotFound, "the host has no address");
    for address in peer.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, CONNECT_WITHIN) {
            Ok(stream) => return Ok(stream),
            Err(error) => last = error,
        }
    }
    Err(last)
}

fn prepare(stream: TcpStream) -> std::io::Result<OwnedFd> {
    stream.set_nodelay(true)?;
    stream.set_nonblocking(true)?;
    set_socket_send_buffer_size(&stream, TCP_WAITING)?;
    Ok(stream.into())
}

fn open_serial(device: &Path, baud: u32) -> std::io::Result<OwnedFd> {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let port = rustix::fs::open(device, flags, Mode::empty()).map_err(|error| match error {
        Errno::ACCESS => Error::other("not permitted: add the user to the group dialout"),
        Errno::BUSY => Error::other("another program has it: stop it"),
        other => other.into(),
    })?;
    let mut settings = tcgetattr(&port).map_err(|error| match error {
        Errno::NOTTY => Error::other("it is no serial port"),
        other => other.into(),
    })?;
    settings.make_raw();
    settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
    settings.control_modes &= !(ControlModes::CRTSCTS | ControlModes::CSTOPB);
    settings.set_speed(baud)?;
    tcsetattr(&port, OptionalActions::Flush, &settings)?;
    if tcgetattr(&port)?.output_speed() != baud {
        return Err(Error::other(format!("it cannot do {baud} bit/s")));
    }
    ioctl_tiocexcl(&port)?; // two programs that read share the bytes, and neither has a whole frame
    Ok(port)
}

/// What a look at the line brought.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// Nothing new.
    Nothing,
    /// The line is open; whatever was held of an older one is gone.
    Opened,
    /// Bytes came.
    Bytes,
    /// The line broke, and why.
    Lost(String),
}

/// The receiving thread's side of a line.
pub(crate) struct LineReader<'a> {
    line: &'a Line,
    port: Option<Arc<OwnedFd>>,
    /// Bytes that came and are not done with.
    held: Vec<u8>,
    retry_at: Option<Time>,
    retry_s: f64,
    heard: Time,
}

impl<'a> LineReader<'a> {
    pub(crate) fn new(line: &'a Line) -> Self {
        let held = Vec::with_capacity(2 * READ);
        Self { line, port: None, held, retry_at: None, retry_s: FIRST_RETRY_S, heard: Time(0) }
    }

    /// Bytes that came and are not done with.
    pub(crate) fn held(&self) -> &[u8] {
        &self.held
    }

    /// The first `used` bytes are done with.
    pub(crate) fn done_with(&mut self, used: usize) {
        self.held.drain(..used);
    }

    /// Looks for 5 ms, or a second where a TCP peer is called. `silent`: the autopilot is not heard; then one that
    /// calls takes the place of the one before.
    pub(crate) fn step(&mut self, now: Time, silent: bool) -> Step {
        let Some(port) = self.port.clone() else { return self.open(now) };
        if silent && self.line.listener.is_some() && self.open(now) == Step::Opened {
            return Step::Opened;
        }
        let wait = Timespec { tv_sec: 0, tv_nsec: WAIT.as_nanos() as i64 };
        let _ = poll(&mut [PollFd::new(&port, PollFlags::IN)], Some(&wait)); // the read tells what is wrong, if anything
        let mut buffer = [0; READ];
        match rustix::io::read(&port, &mut buffer) {
            Ok(0) => self.lost(now, "the other end closed it".to_owned()),
            Ok(length) => {
                self.held.extend_from_slice(&buffer[..length]);
                (self.heard, self.retry_s) = (now, FIRST_RETRY_S);
                Step::Bytes
            }
            Err(Errno::AGAIN | Errno::INTR) => {
                let tcp = matches!(self.line.address, Address::TcpOut(_));
                if tcp && silent && now.since(self.heard) > TCP_SILENCE_S {
                    self.lost(now, format!("nothing came for {TCP_SILENCE_S} s"))
                } else {
                    Step::Nothing
                }
            }
            Err(error) => self.lost(now, Error::from(error).to_string()),
        }
    }

    fn open(&mut self, now: Time) -> Step {
        if self.port.is_none() && self.retry_at.is_some_and(|at| now < at) {
            std::thread::sleep(WAIT);
            return Step::Nothing;
        }
        match self.line.open() {
            Ok(Some(port)) => {
                let port = Arc::new(port);
                self.held.clear();
                self.heard = now;
                *lock(&self.line.out) = Some(Outgoing { port: Arc::clone(&port), rest: Vec::with_capacity(READ) });
                *lock(&self.line.problem) = None;
                self.port = Some(port);
                Step::Opened
            }
            Ok(None) => {
                if self.port.is_none() {
                    *lock(&self.line.problem) = Some(format!("nobody has called at {} yet", self.line.address));
                    std::thread::sleep(WAIT);
                }
                Step::Nothing
            }
            Err(error) => {
                self.broken(now, &format!("cannot be opened: {error}"));
                Step::Nothing
            }
        }
    }

    fn lost(&mut self, now: Time, why: String) -> Step {
        *lock(&self.line.out) = None;
        self.port = None;
        self.broken(now, &format!("broke: {why}"));
        Step::Lost(why)
    }

    fn broken(&mut self, now: Time, what: &str) {
        let problem = format!("{} {what}", self.line.address);
        let mut told = lock(&self.line.problem);
        if told.as_ref() != Some(&problem) {
            tracing::warn!("{problem}; it is tried again");
        }
        *told = Some(problem);
        self.retry_at = Some(now.plus(self.retry_s));
        self.retry_s = (2.0 * self.retry_s).min(LAST_RETRY_S);
    }
}
