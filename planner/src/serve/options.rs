//! What a caller sets: address and limits.

use std::time::Duration;

use schema::{Mat3, Quat, Vec3};
use settings::words;

/// Address and limits of the service.
#[derive(Debug, Clone)]
pub struct ServeOptions {
    /// Address to listen on, or a name of one. There are no passwords: anyone who reaches it may use it.
    pub host: String,
    /// Names by which clients may call the service, besides localhost and addresses.
    pub allow_host: Vec<String>,
    /// Port; 0 for any that is free.
    pub port: u16,
    /// Largest request.
    pub body_bytes_max: usize,
    /// Maximum time from a request to its answer.
    pub request_timeout: Duration,
    /// Plans made concurrently.
    pub concurrent: u16,
    /// Plans that may wait; further requests are refused.
    pub queue: u16,
    /// Maximum time from an answer to the next request's complete header.
    pub silence_max: Duration,
    /// The axes of the grasps of `/predict`.
    pub grasp_frame: GraspFrame,
}

words! {
    /// Axes of a grasp, by the names of the servers that have them; the origin is always between the finger tips' ends.
    pub enum GraspFrame {
        /// x approaches, y closes.
        DexGraspNet2 = "dexgraspnet2",
        /// z approaches, x closes.
        GraspGenX = "graspgenx",
        /// z approaches, y closes: Graspmill's own.
        TcpZApproach = "tcp_z_approach",
    }
}

impl GraspFrame {
    /// These axes in those of Graspmill's grasps.
    pub(super) fn grasp_from_frame(self) -> Quat {
        let columns = match self {
            Self::DexGraspNet2 => [Vec3::Z, Vec3::Y, Vec3::NEG_X],
            Self::GraspGenX => [Vec3::Y, Vec3::NEG_X, Vec3::Z],
            Self::TcpZApproach => [Vec3::X, Vec3::Y, Vec3::Z],
        };
        let [x, y, z] = columns;
        Quat::from_mat3(&Mat3::from_cols(x, y, z))
    }
}
