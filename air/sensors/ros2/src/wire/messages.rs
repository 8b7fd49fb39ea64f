//! The ROS 2 messages that cross, field by field as their definitions have them, with each type's name and hash.
//!
//! A hash (RIHS01) is of a type's definition, and of those that it holds. These definitions are the same in every release
//! that has hashes; `tests/ros2` compares them with those that rosbags works out.

use serde::{Deserialize, Serialize};

/// A type as rmw_zenoh names it.
pub trait Message {
    /// Its name in keys and tokens.
    const TYPE: &'static str;
    /// The hash of its definition.
    const HASH: &'static str;
    /// It holds a list of bytes itself: `graph.rs` says what that changes.
    const BUFFERS: bool = false;
}

macro_rules! message {
    ($message:ty, $package:literal, $name:literal, $hash:literal $(, $constant:ident = $value:literal)?) => {
        impl Message for $message {
            const TYPE: &'static str = concat!($package, "::msg::dds_::", $name, "_");
            const HASH: &'static str = concat!("RIHS01_", $hash);
            $(const $constant: bool = $value;)?
        }
    };
}

message!(
    Image<'_>,
    "sensor_msgs",
    "Image",
    "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
    BUFFERS = true
);
message!(
    CompressedImage<'_>,
    "sensor_msgs",
    "CompressedImage",
    "15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a",
    BUFFERS = true
);
message!(CameraInfo, "sensor_msgs", "CameraInfo", "b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275");
message!(Odometry, "nav_msgs", "Odometry", "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0");
message!(Path, "nav_msgs", "Path", "1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b");
message!(
    PoseStamped,
    "geometry_msgs",
    "PoseStamped",
    "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"
);
message!(
    PoseWithCovarianceStamped,
    "geometry_msgs",
    "PoseWithCovarianceStamped",
    "26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e"
);
message!(TfMessage, "tf2_msgs", "TFMessage", "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087");
message!(
    MarkerArray,
    "visualization_msgs",
    "MarkerArray",
    "86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf"
);

/// `builtin_interfaces/Time`: of the system's clock, since 1970.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stamp {
    /// s.
    pub sec: i32,
    /// ns, below 10^9.
    pub nanosec: u32,
}

/// `std_msgs/Header`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// When it was so.
    pub stamp: Stamp,
    /// In whose frame.
    pub frame_id: String,
}

/// `sensor_msgs/Image`. The pixels stay where they were received.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Image<'a> {
    #[allow(missing_docs)]
    pub header: Header,
    /// px.
    pub height: u32,
    /// px.
    pub width: u32,
    /// Such as `rgb8`, `16UC1`.
    pub encoding: String,
    /// Of pixels of more than a byte; 0: little endian.
    pub is_bigendian: u8,
    /// Bytes a row.
    pub step: u32,
    /// height × step.
    pub data: &'a [u8],
}

/// `sensor_msgs/CompressedImage`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CompressedImage<'a> {
    #[allow(missing_docs)]
    pub header: Header,
    /// Such as `jpeg`, `rgb8; jpeg compressed bgr8`, `16UC1; compressedDepth png`.
    pub format: String,
    /// A file of that format.
    pub data: &'a [u8],
}

/// `sensor_msgs/RegionOfInterest`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct RegionOfInterest {
    pub x_offset: u32,
    pub y_offset: u32,
    pub height: u32,
    pub width: u32,
    pub do_rectify: bool,
}

/// `sensor_msgs/CameraInfo`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraInfo {
    #[allow(missing_docs)]
    pub header: Header,
    /// px.
    pub height: u32,
    /// px.
    pub width: u32,
    /// Such as `plumb_bob`.
    pub distortion_model: String,
    /// Its coefficients.
    pub d: Vec<f64>,
    /// fx, 0, cx, 0, fy, cy, 0, 0, 1; px.
    pub k: [f64; 9],
    /// Rectification.
    pub r: [f64; 9],
    /// Projection after it.
    pub p: [f64; 12],
    /// 0 and 1: none.
    pub binning_x: u32,
    /// As `binning_x`.
    pub binning_y: u32,
    /// All zero: the whole image.
    pub roi: RegionOfInterest,
}

/// `geometry_msgs/Point` and `Vector3`, m.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct Vector3 {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

/// `geometry_msgs/Quaternion`: the scalar last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct Quaternion {
    pub x: f64,
    pub y: f64,
    pub z: f64,
    pub w: f64,
}

/// `geometry_msgs/Pose`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct Pose {
    pub position: Vector3,
    pub orientation: Quaternion,
}

/// 6 × 6, row-major; three of position or linear, three of rotation or angular.
pub type Covariance = [[f64; 6]; 6];

/// `geometry_msgs/PoseWithCovariance`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct PoseWithCovariance {
    pub pose: Pose,
    pub covariance: Covariance,
}

/// `geometry_msgs/Twist`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Twist {
    /// m/s.
    pub linear: Vector3,
    /// rad/s.
    pub angular: Vector3,
}

/// `geometry_msgs/TwistWithCovariance`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct TwistWithCovariance {
    pub twist: Twist,
    pub covariance: Covariance,
}

/// `nav_msgs/Odometry`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Odometry {
    /// Its frame is the pose's.
    pub header: Header,
    /// Whose pose it is; by the definition the twist's frame too.
    pub child_frame_id: String,
    #[allow(missing_docs)]
    pub pose: PoseWithCovariance,
    #[allow(missing_docs)]
    pub twist: TwistWithCovariance,
}

/// `geometry_msgs/PoseStamped`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct PoseStamped {
    pub header: Header,
    pub pose: Pose,
}

/// `geometry_msgs/PoseWithCovarianceStamped`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct PoseWithCovarianceStamped {
    pub header: Header,
    pub pose: PoseWithCovariance,
}

/// `nav_msgs/Path`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct Path {
    pub header: Header,
    pub poses: Vec<PoseStamped>,
}

/// `geometry_msgs/TransformStamped`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct TransformStamped {
    pub header: Header,
    pub child_frame_id: String,
    pub translation: Vector3,
    pub rotation: Quaternion,
}

/// `tf2_msgs/TFMessage`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct TfMessage {
    pub transforms: Vec<TransformStamped>,
}

/// `std_msgs/ColorRGBA`, 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct Colour {
    pub r: f32,
    pub g: f32,
    pub b: f32,
    pub a: f32,
}

/// `visualization_msgs/Marker`, of the kinds that have neither picture nor mesh.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Marker {
    #[allow(missing_docs)]
    pub header: Header,
    /// With `id` what a later marker replaces.
    pub ns: String,
    #[allow(missing_docs)]
    pub id: i32,
    /// 4: a line strip.
    pub kind: i32,
    /// 0: add; 3: delete all.
    pub action: i32,
    #[allow(missing_docs)]
    pub pose: Pose,
    /// m; of a line its width as x.
    pub scale: Vector3,
    #[allow(missing_docs)]
    pub colour: Colour,
    /// s and ns; 0: for ever.
    pub lifetime: (i32, u32),
    #[allow(missing_docs)]
    pub frame_locked: bool,
    #[allow(missing_docs)]
    pub points: Vec<Vector3>,
    /// One a point, or none.
    pub colours: Vec<Colour>,
    #[allow(missing_docs)]
    pub texture_resource: String,
    #[allow(missing_docs)]
    pub texture: NoPicture,
    #[allow(missing_docs)]
    pub uv_coordinates: Vec<(f32, f32)>,
    #[allow(missing_docs)]
    pub text: String,
    #[allow(missing_docs)]
    pub mesh_resource: String,
    #[allow(missing_docs)]
    pub mesh_file: NoFile,
    #[allow(missing_docs)]
    pub mesh_use_embedded_materials: bool,
}

/// An empty `sensor_msgs/CompressedImage`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct NoPicture {
    pub header: Header,
    pub format: String,
    pub data: Vec<u8>,
}

/// An empty `visualization_msgs/MeshFile`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct NoFile {
    pub filename: String,
    pub data: Vec<u8>,
}

/// `visualization_msgs/MarkerArray`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct MarkerArray {
    pub markers: Vec<Marker>,
}
