//! `graspmill dataset`, under the name `shards`.

mod program;
mod remote;
