//! The channels of a flight log: a topic and the message that it carries.

use goshawk_proto::keys::Key;

/// One channel. Telemetry keeps its key's suffix as topic; what only the log holds is under `log/`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Channel {
    /// MCAP topic.
    pub topic: &'static str,
    /// Full protobuf name of its messages.
    pub message: &'static str,
}

impl Channel {
    /// Vehicle file, policy, revision: the first record of each log.
    pub const HEADER: Channel = Channel { topic: "log/header", message: "goshawk.v1.LogHeader" };
    /// Images at the network's size, without loss.
    pub const RGBD: Channel = Channel { topic: "log/rgbd", message: "goshawk.v1.CompressedRgbd" };
    /// Odometry as the controller took it.
    pub const ODOMETRY: Channel = Channel { topic: "log/odometry", message: "goshawk.v1.Odometry" };
    /// Each new sample of the autopilot's IMU, before the step that sees it.
    pub const IMU: Channel = Channel { topic: "log/imu", message: "goshawk.v1.Imu" };
    /// What the planner was given for each frame.
    pub const PLANNER_INPUT: Channel = Channel { topic: "log/planner_input", message: "goshawk.v1.PlannerInput" };
    /// What the controller was given at each step.
    pub const CONTROLLER_INPUT: Channel =
        Channel { topic: "log/controller_input", message: "goshawk.v1.ControllerInput" };
    /// Commands with their replies.
    pub const COMMAND: Channel = Channel { topic: "log/command", message: "goshawk.v1.CommandRecord" };

    /// What stands still in a simulator's world; a real vehicle has none.
    pub const WORLD: Channel = Channel { topic: "log/world", message: "goshawk.v1.SimWorld" };

    /// The channel of a published key; none for a query or a liveliness token, which carry no record.
    #[must_use]
    pub fn of(key: Key) -> Option<Channel> {
        let row = key.row();
        row.message.map(|message| Channel { topic: row.suffix, message })
    }
}
