//! The flight log of a chaos flight: the vehicle's own records and writer over a disk that can be full, slow, or gone.
//! As on board, a log begins with an accepted start, waits in a bounded queue, and is flushed twice a second.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::io::{self, BufWriter, Write};
use std::rc::Rc;

use goshawk_core::{Mode, Time};
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_recorder::{Channel, LogWriter};
use goshawk_vehicle::{convert, inputs};
use prost::Message;

use crate::commands::chaos::aboard::{Planned, Stepped};

/// As the recorder's.
const QUEUE: usize = 1024;
const FLUSH_EVERY_S: f64 = 0.5;
/// As the flight log's: it goes on for so long after the landing, s.
const TAIL_S: f64 = 1.0;

/// The disk under a log.
struct Sink {
    bytes: Rc<RefCell<Vec<u8>>>,
    full: Rc<Cell<bool>>,
}

impl Write for Sink {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        if self.full.get() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.bytes.borrow_mut().extend_from_slice(buffer);
        Ok(buffer.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// What is safe on the disk from then on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Flush {
    pub(crate) bytes: usize,
    pub(crate) records: u64,
    /// Controller steps among them.
    pub(crate) steps: u64,
    /// When it was done.
    pub(crate) at: Time,
}

/// A log as the disk has it in the end.
pub(crate) struct Written {
    pub(crate) bytes: Vec<u8>,
    pub(crate) flushes: Vec<Flush>,
    pub(crate) begun: Time,
    /// It was finished.
    pub(crate) closed: bool,
    /// When the first record was lost, for want of room in the queue or on the disk.
    pub(crate) lost: Option<Time>,
    /// The vehicle's last step that belongs to it.
    pub(crate) ended: Time,
    /// All that was written.
    pub(crate) total: Flush,
}

type Record = (Channel, Time, Vec<u8>);

struct Open {
    begun: Time,
    writer: Option<LogWriter<BufWriter<Sink>>>,
    bytes: Rc<RefCell<Vec<u8>>>,
    queue: VecDeque<Record>,
    flushes: Vec<Flush>,
    total: Flush,
    lost: Option<Time>,
    flushed: Time,
    ended: Time,
    finish_at: Option<Time>,
}

/// The recorder over the disk.
pub(crate) struct Recorder {
    header: v1::LogHeader,
    open: Option<Open>,
    full: Rc<Cell<bool>>,
    slow: bool,
    written: Vec<Written>,
    odometry: u64,
    targets: u64,
}

impl Recorder {
    pub(crate) fn new(header: v1::LogHeader) -> Self {
        Self { header, open: None, full: Rc::default(), slow: false, written: Vec::new(), odometry: 0, targets: 0 }
    }

    /// A millisecond of the disk's.
    pub(crate) fn step(&mut self, now: Time, full: bool, slow: bool) {
        self.full.set(full);
        self.slow = slow;
        let Some(open) = &mut self.open else { return };
        if open.finish_at.is_some_and(|at| now >= at) {
            self.close();
            return;
        }
        if !slow {
            open.drain();
            if now.since(open.flushed) >= FLUSH_EVERY_S {
                open.flush(now);
            }
        }
    }

    /// A step of the controller.
    pub(crate) fn control(&mut self, now: Time, stepped: &Stepped) {
        let Stepped { seq, input, output, fresh, started } = stepped;
        if *started {
            self.begin(now);
        }
        if let Some(odometry) = input.odometry.filter(|_| *fresh || *started) {
            self.odometry += 1;
            self.record(Channel::ODOMETRY, odometry.stamp, &convert::odometry(self.odometry, &odometry));
        }
        self.record(Channel::CONTROLLER_INPUT, now, &inputs::controller_input(input, *seq, now));
        self.tell(Key::Control, now, &convert::control(*seq, now, output, input.odometry.as_ref()));
        if let Some(open) = &mut self.open {
            open.ended = now;
            if output.transition.is_some() && matches!(output.mode, Mode::Landed | Mode::Idle | Mode::Ready) {
                open.finish_at = Some(now.plus(TAIL_S));
            }
        }
    }

    /// A plan was handed over, in the log's flight or before it.
    pub(crate) fn plan(&mut self, now: Time, flight: u64, planned: &Planned) {
        if planned.record.frame.flight != flight {
            return;
        }
        self.record(Channel::PLANNER_INPUT, now, &inputs::planner_input(&planned.record));
        self.tell(Key::Plan, now, &convert::plan(&planned.plan, now));
        if let Some(target) = convert::target(self.targets + 1, &planned.plan) {
            self.targets += 1;
            self.tell(Key::Target, now, &target);
        }
    }

    /// A command was answered.
    pub(crate) fn command(&mut self, now: Time, record: &v1::CommandRecord) {
        self.record(Channel::COMMAND, now, record);
    }

    fn begin(&mut self, now: Time) {
        self.close();
        let bytes = Rc::new(RefCell::new(Vec::new()));
        let sink = Sink { bytes: Rc::clone(&bytes), full: Rc::clone(&self.full) };
        let total = Flush { bytes: 0, records: 0, steps: 0, at: now };
        self.open = Some(Open {
            begun: now,
            writer: LogWriter::new(BufWriter::new(sink)).ok(),
            bytes,
            queue: VecDeque::new(),
            flushes: Vec::new(),
            total,
            lost: None,
            flushed: now,
            ended: now,
            finish_at: None,
        });
        let header = v1::LogHeader { stamp_ns: now.0, ..self.header.clone() };
        self.record(Channel::HEADER, now, &header);
    }

    fn tell(&mut self, key: Key, stamp: Time, message: &impl Message) {
        if let Some(channel) = Channel::of(key) {
            self.record(channel, stamp, message);
        }
    }

    fn record(&mut self, channel: Channel, stamp: Time, message: &impl Message) {
        let Some(open) = &mut self.open else { return };
        if open.writer.is_none() || open.queue.len() == QUEUE {
            open.lost = open.lost.or(Some(stamp));
        } else {
            open.queue.push_back((channel, stamp, message.encode_to_vec()));
        }
    }

    /// As on board, it waits for the disk.
    fn close(&mut self) {
        let Some(mut open) = self.open.take() else { return };
        open.drain();
        let finished = open.writer.take().map(|writer| writer.finish().map(|mut sink| sink.flush()));
        let closed = matches!(finished, Some(Ok(Ok(()))));
        self.written.push(open.end(closed));
    }

    /// The power is cut: what the logs are then.
    pub(crate) fn cut(mut self) -> Vec<Written> {
        if let Some(open) = self.open.take() {
            self.written.push(open.end(false));
        }
        self.written
    }
}

impl Open {
    fn drain(&mut self) {
        while let Some(writer) = &mut self.writer {
            let Some((channel, stamp, payload)) = self.queue.pop_front() else { return };
            if writer.write(channel, stamp.0, &payload).is_err() {
                self.fail(stamp);
                return;
            }
            self.total.records += 1;
            if channel == Channel::CONTROLLER_INPUT {
                self.total.steps += 1;
            }
        }
    }

    fn flush(&mut self, now: Time) {
        self.flushed = now;
        let Some(writer) = &mut self.writer else { return };
        if writer.flush().is_err() {
            self.fail(now);
            return;
        }
        (self.total.bytes, self.total.at) = (self.bytes.borrow().len(), now);
        self.flushes.push(self.total);
    }

    /// The recording ends. What the writer still holds never reaches the disk.
    fn fail(&mut self, at: Time) {
        self.lost = self.lost.or(Some(at));
        let kept = self.bytes.borrow().clone();
        self.bytes = Rc::new(RefCell::new(kept));
        (self.writer, self.queue) = (None, VecDeque::new());
    }

    fn end(self, closed: bool) -> Written {
        // A copy, before the writer is dropped: a process that is killed writes nothing more.
        let bytes = self.bytes.borrow().clone();
        let Self { begun, flushes, lost, ended, total, .. } = self;
        Written { bytes, flushes, begun, closed, lost, ended, total }
    }
}
