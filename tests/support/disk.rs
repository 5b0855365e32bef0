//! A small disk, for tests of what happens when it is full.

use std::path::Path;
use std::process::{Command, Stdio};

/// A tmpfs, which only root can mount.
pub(crate) struct Disk(tempfile::TempDir);

impl Disk {
    /// None if this machine cannot mount it. Under `GRASPMILL_NO_SKIPS` scripts/test.sh must have found so, too.
    #[expect(clippy::print_stderr, reason = "whoever runs the tests should know what was not tested")]
    pub(crate) fn mount(kibibytes: u32) -> Option<Self> {
        let disk = Self(tempfile::tempdir().unwrap());
        if disk.mounts(&format!("size={kibibytes}k")) {
            return Some(disk);
        }
        let missing = std::env::var("GRASPMILL_MISSING").unwrap_or_default();
        let may_skip = std::env::var("GRASPMILL_NO_SKIPS").as_deref() != Ok("1")
            || missing.split_whitespace().any(|name| name == "mount");
        assert!(may_skip, "cannot mount a small disk");
        eprintln!("skipped: cannot mount a small disk here");
        None
    }

    pub(crate) fn path(&self) -> &Path {
        self.0.path()
    }

    pub(crate) fn grow(&self, kibibytes: u32) {
        assert!(self.mounts(&format!("remount,size={kibibytes}k")), "the disk did not grow");
    }

    fn mounts(&self, options: &str) -> bool {
        let mut command = Command::new("mount");
        command.args(["-t", "tmpfs", "-o", options, "tmpfs"]).arg(self.path()).stderr(Stdio::null());
        command.status().is_ok_and(|status| status.success())
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.path()).stderr(Stdio::null()).status();
    }
}
