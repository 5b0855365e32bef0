//! A full disk stops a writer with "run it again"; when there is space again, it continues.

use std::path::Path;
use std::process::{Command, Stdio};

use program::{ExitCode, Failure};
use shards::Draft;

use crate::sample;

/// A small separate disk; only root can mount one.
struct Disk(tempfile::TempDir);

impl Disk {
    fn mount(kibibytes: u32) -> Option<Self> {
        let dir = tempfile::tempdir().unwrap();
        mount(dir.path(), &format!("size={kibibytes}k")).then_some(Self(dir))
    }

    fn grow(&self, kibibytes: u32) {
        assert!(mount(self.0.path(), &format!("remount,size={kibibytes}k")));
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.0.path()).status();
    }
}

fn mount(dir: &Path, options: &str) -> bool {
    let mut command = Command::new("mount");
    command.args(["-t", "tmpfs", "-o", options]).arg("tmpfs").arg(dir).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

fn write(draft: &Draft, shard: u32) -> Result<(), Failure> {
    let mut writer = draft.shard(shard)?;
    for rows in sample::rows(draft.info(), shard) {
        writer.push(&rows)?;
    }
    writer.commit().map(drop)
}

#[test]
fn a_full_disk_loses_nothing() {
    let Some(disk) = Disk::mount(160) else {
        eprintln!("skipped: cannot mount a small disk here");
        return;
    };
    let mut info = sample::sized(2, 4, 400, 10);
    info.grid.resolution = 16;
    let dir = disk.0.path();
    let draft = Draft::begin(dir, &info).unwrap();
    let (full, error) = (0..4).find_map(|shard| write(&draft, shard).err().map(|e| (shard, e))).unwrap();
    assert_eq!(error.exit_code(), ExitCode::TryAgain, "{error}");
    assert!(full > 0, "the first shard fits");
    for shard in 0..4 {
        assert_eq!(draft.is_committed(shard).unwrap(), shard < full);
    }
    disk.grow(4096);
    for shard in full..4 {
        write(&draft, shard).unwrap();
    }
    draft.finalize().unwrap();
    assert!(shards::verify(dir, |_| ()).unwrap().is_ok());
}
