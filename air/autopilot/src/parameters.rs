//! The autopilot's parameters: asked for by name, read as PX4 encodes them.

use crate::messages::{MavMessage, MavParamType, PARAM_REQUEST_READ_DATA, PARAM_VALUE_DATA};

/// Parameters remembered; nobody asks for more.
pub(crate) const KEPT: usize = 64;

/// A parameter's value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Parameter {
    /// An integer one.
    Int(i32),
    /// A real one.
    Real(f32),
}

/// The message that asks `system`/`component` for the parameter `name` (at most 16 bytes).
#[must_use]
pub fn request(name: &str, system: u8, component: u8) -> MavMessage {
    MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
        param_index: -1, // by name
        target_system: system,
        target_component: component,
        param_id: name.into(),
    })
}

/// The message that tells a parameter: PX4 puts an integer's bytes where the float is.
#[must_use]
pub fn value(name: &str, parameter: Parameter) -> MavMessage {
    let (param_value, param_type) = match parameter {
        Parameter::Int(value) => (f32::from_bits(value.cast_unsigned()), MavParamType::MAV_PARAM_TYPE_INT32),
        Parameter::Real(value) => (value, MavParamType::MAV_PARAM_TYPE_REAL32),
    };
    let param_id = name.into();
    MavMessage::PARAM_VALUE(PARAM_VALUE_DATA { param_value, param_count: 1, param_index: 0, param_id, param_type })
}

/// Name and value that a message tells; none: not text, or of a type that PX4 does not use.
#[must_use]
pub fn told(message: &PARAM_VALUE_DATA) -> Option<(String, Parameter)> {
    let name = message.param_id.to_str().ok()?.trim_end_matches('\0').to_owned();
    let parameter = match message.param_type {
        MavParamType::MAV_PARAM_TYPE_INT32 => Parameter::Int(message.param_value.to_bits().cast_signed()),
        MavParamType::MAV_PARAM_TYPE_REAL32 => Parameter::Real(message.param_value),
        _ => return None,
    };
    Some((name, parameter))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_told_is_read_back_integers_to_the_last_bit() {
        for parameter in [Parameter::Int(-1), Parameter::Int(4), Parameter::Int(i32::MIN), Parameter::Real(0.5)] {
            let MavMessage::PARAM_VALUE(message) = value("COM_OF_LOSS_T", parameter) else { panic!() };
            let (name, back) = told(&message).unwrap();
            assert_eq!((name.as_str(), back), ("COM_OF_LOSS_T", parameter));
        }
    }
}
