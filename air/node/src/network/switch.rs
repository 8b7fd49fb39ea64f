//! The pilot's switch: what it asks for goes to the controller as the ground's commands do.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use goshawk_autopilot::AutopilotLink;
use goshawk_proto::v1;
use goshawk_vehicle::clock;
use goshawk_vehicle::config::{Position, Switch, Vehicle};
use goshawk_vehicle::desk::{self, Parsed};
use goshawk_vehicle::switch::{SwitchReader, problem};

use crate::flight::shared::{Report, Shared};
use crate::network::commands;

/// The radio is looked at so often. Chosen by eye.
const POLL: Duration = Duration::from_millis(20);

/// Looks at the switch until the process stops.
pub fn serve(switch: &Switch, link: &Arc<AutopilotLink>, shared: &Shared, vehicle: &Vehicle) {
    let (mut reader, mut heard, mut moves) = (SwitchReader::default(), false, 0_u64);
    let mut wanted: Option<Parsed> = None;
    while !shared.stopping() {
        std::thread::sleep(POLL);
        let (now, radio) = (clock::now(), link.radio());
        let moved = reader.take(now, switch, radio.as_ref());
        let free = matches!(reader.position(), Some(Position::Start | Position::Hold));
        shared.barred.store(!free, Ordering::Relaxed);
        let lost = problem(now, switch, radio.as_ref());
        if lost.is_none() != heard {
            heard = lost.is_none();
            let severity = if heard { v1::Severity::Info } else { v1::Severity::Warning };
            shared.report(Report::Event(
                severity,
                "switch",
                lost.unwrap_or_else(|| "the pilot's radio is heard".to_owned()),
            ));
        }
        if let Some(position) = moved {
            moves += 1;
            wanted = desk::by_switch(format!("switch-{moves}"), position, shared.flies(), vehicle);
        }
        if let Some(parsed) = wanted.take() {
            wanted = carry_out(parsed, shared);
        }
    }
}

/// What must be asked again: a hold or a stop that the controller did not get to.
fn carry_out(parsed: Parsed, shared: &Shared) -> Option<Parsed> {
    let flew = shared.flies();
    let decided = commands::ask(&parsed, shared);
    let decided = if flew { decided } else { commands::nothing_to_stop(&parsed, decided, shared) };
    let urgent = matches!(parsed.verb(), "hold" | "stop");
    if urgent && !decided.reply.accepted {
        return Some(parsed);
    }
    let reply = commands::record(&parsed, decided, shared).reply;
    let severity = if reply.accepted { v1::Severity::Info } else { v1::Severity::Warning };
    let text = format!("the pilot's switch asked to {}: {}", parsed.verb(), reply.reason);
    shared.report(Report::Event(severity, "switch", text));
    None
}
