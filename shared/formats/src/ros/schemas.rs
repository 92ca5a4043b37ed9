//! Definitions of the messages that are written, in the form that MCAP and ROS 2 bags call `ros2msg`: the message itself,
//! then every type that it names, each behind a line of `=` and its name.

/// A message type with its whole definition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Schema {
    /// Name with package, for example `sensor_msgs/msg/Imu`.
    pub name: &'static str,
    /// The definition.
    pub text: &'static str,
}

macro_rules! rule {
    ($name:literal) => {
        concat!(
            "================================================================================\nMSG: ",
            $name,
            "\n"
        )
    };
}
macro_rules! header {
    () => {
        concat!(
            rule!("std_msgs/Header"),
            "builtin_interfaces/Time stamp\nstring frame_id\n",
            rule!("builtin_interfaces/Time"),
            "int32 sec\nuint32 nanosec\n"
        )
    };
}
macro_rules! quaternion {
    () => {
        concat!(rule!("geometry_msgs/Quaternion"), "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n")
    };
}
macro_rules! vector3 {
    () => {
        concat!(rule!("geometry_msgs/Vector3"), "float64 x\nfloat64 y\nfloat64 z\n")
    };
}
macro_rules! pose {
    () => {
        concat!(
            rule!("geometry_msgs/Pose"),
            "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
            rule!("geometry_msgs/Point"),
            "float64 x\nfloat64 y\nfloat64 z\n",
            quaternion!()
        )
    };
}

/// `sensor_msgs/msg/PointCloud2`
pub const POINT_CLOUD2: Schema = Schema {
    name: "sensor_msgs/msg/PointCloud2",
    text: concat!(
        "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n",
        "uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n",
        header!(),
        rule!("sensor_msgs/PointField"),
        "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\nuint8 UINT32=6\n",
        "uint8 FLOAT32=7\nuint8 FLOAT64=8\nstring name\nuint32 offset\nuint8 datatype\nuint32 count\n"
    ),
};

/// `sensor_msgs/msg/Imu`
pub const IMU: Schema = Schema {
    name: "sensor_msgs/msg/Imu",
    text: concat!(
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n",
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n",
        "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n",
        header!(),
        quaternion!(),
        vector3!()
    ),
};

/// `geometry_msgs/msg/PoseStamped`
pub const POSE_STAMPED: Schema = Schema {
    name: "geometry_msgs/msg/PoseStamped",
    text: concat!("std_msgs/Header header\ngeometry_msgs/Pose pose\n", header!(), pose!()),
};

/// `nav_msgs/msg/Odometry`
pub const ODOMETRY: Schema = Schema {
    name: "nav_msgs/msg/Odometry",
    text: concat!(
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n",
        "geometry_msgs/TwistWithCovariance twist\n",
        header!(),
        rule!("geometry_msgs/PoseWithCovariance"),
        "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
        pose!(),
        rule!("geometry_msgs/TwistWithCovariance"),
        "geometry_msgs/Twist twist\nfloat64[36] covariance\n",
        rule!("geometry_msgs/Twist"),
        "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
        vector3!()
    ),
};

/// `tf2_msgs/msg/TFMessage`
pub const TF_MESSAGE: Schema = Schema {
    name: "tf2_msgs/msg/TFMessage",
    text: concat!(
        "geometry_msgs/TransformStamped[] transforms\n",
        rule!("geometry_msgs/TransformStamped"),
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
        header!(),
        rule!("geometry_msgs/Transform"),
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
        vector3!(),
        quaternion!()
    ),
};

/// `nav_msgs/msg/OccupancyGrid`
pub const OCCUPANCY_GRID: Schema = Schema {
    name: "nav_msgs/msg/OccupancyGrid",
    text: concat!(
        "std_msgs/Header header\nnav_msgs/MapMetaData info\nint8[] data\n",
        header!(),
        rule!("nav_msgs/MapMetaData"),
        "builtin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\nuint32 height\n",
        "geometry_msgs/Pose origin\n",
        pose!()
    ),
};

/// `octomap_msgs/msg/Octomap`
pub const OCTOMAP: Schema = Schema {
    name: "octomap_msgs/msg/Octomap",
    text: concat!(
        "std_msgs/Header header\nbool binary\nstring id\nfloat64 resolution\nint8[] data\n",
        header!()
    ),
};

/// `diagnostic_msgs/msg/DiagnosticArray`
pub const DIAGNOSTIC_ARRAY: Schema = Schema {
    name: "diagnostic_msgs/msg/DiagnosticArray",
    text: concat!(
        "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status\n",
        header!(),
        rule!("diagnostic_msgs/DiagnosticStatus"),
        "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\nbyte level\nstring name\nstring message\n",
        "string hardware_id\ndiagnostic_msgs/KeyValue[] values\n",
        rule!("diagnostic_msgs/KeyValue"),
        "string key\nstring value\n"
    ),
};

/// `std_msgs/msg/UInt8MultiArray`
pub const OCTETS: Schema = Schema {
    name: "std_msgs/msg/UInt8MultiArray",
    text: concat!(
        "std_msgs/MultiArrayLayout layout\nuint8[] data\n",
        rule!("std_msgs/MultiArrayLayout"),
        "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n",
        rule!("std_msgs/MultiArrayDimension"),
        "string label\nuint32 size\nuint32 stride\n"
    ),
};
