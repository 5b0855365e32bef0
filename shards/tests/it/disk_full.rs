//! A full disk stops a writer with "run it again"; when there is space again, it continues.

use program::{ExitCode, Failure};
use shards::Draft;

use crate::disk::Disk;
use crate::sample;

fn write(draft: &Draft, shard: u32) -> Result<(), Failure> {
    let mut writer = draft.shard(shard)?;
    for rows in sample::rows(draft.info(), shard) {
        writer.push(&rows)?;
    }
    writer.commit().map(drop)
}

#[test]
fn a_full_disk_loses_nothing() {
    let Some(disk) = Disk::mount(160) else { return };
    let mut info = sample::sized(2, 4, 400, 10);
    info.grid.resolution = 16;
    let dir = disk.path();
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
