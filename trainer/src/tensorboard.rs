//! Event files for TensorBoard: scalars of a run, under `tensorboard/` in the run's folder.
//!
//! For TensorBoard each set is a separate run (`train`, `test_attempts`, `test_scenes`) with the same tags, so that one
//! chart shows all three; the horizontal axis is the step. An event file is named by the step and the number of
//! complete epochs at its start, and ends at the next checkpoint. Resuming from a checkpoint therefore drops later
//! events by deleting whole files; otherwise TensorBoard would show repeated steps twice. Event files contain the time,
//! so their bytes differ between runs, but their scalars do not.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use syntaxdot_summary::SummaryWriter;

use crate::events::EpochReport;
use crate::metrics::Summary;

/// The folder in a run's folder.
pub(crate) const FOLDER: &str = "tensorboard";

/// Interval of the loss's points, in steps.
const EVERY_STEPS: u64 = 10;

const SETS: [&str; 3] = ["train", "test_attempts", "test_scenes"];
const TRAIN: usize = 0;

/// The position of a run: steps and complete epochs. An epoch is complete some time after its last step.
type Place = (u64, u32);

/// The event files of a run that is being trained.
pub(crate) struct Events {
    folder: PathBuf,
    checkpoint_every_steps: u64,
    /// The position at which the next files begin.
    first: Place,
    writers: [Option<SummaryWriter<File>>; 3],
}

impl Events {
    /// Resumes at a position; later events are dropped.
    ///
    /// # Errors
    /// The system's error.
    pub(crate) fn begin(folder: &Path, checkpoint_every_steps: u32, first: Place) -> io::Result<Self> {
        for set in SETS {
            drop_later(&folder.join(set), first)?;
        }
        let checkpoint_every_steps = checkpoint_every_steps.into();
        Ok(Self { folder: folder.to_owned(), checkpoint_every_steps, first, writers: [None, None, None] })
    }

    /// Records the loss of a training step.
    ///
    /// # Errors
    /// The system's error.
    pub(crate) fn step(&mut self, step: u64, loss: f64) -> io::Result<()> {
        if step.is_multiple_of(EVERY_STEPS) {
            self.scalar(TRAIN, "loss/step", step, loss)?;
        }
        if self.checkpoint_every_steps > 0 && step.is_multiple_of(self.checkpoint_every_steps) {
            self.begin_files_after((step, self.first.1));
        }
        Ok(())
    }

    /// Records an epoch's defined losses and ratios.
    ///
    /// # Errors
    /// The system's error.
    pub(crate) fn epoch(&mut self, report: &EpochReport) -> io::Result<()> {
        for (set, summary) in [&report.train, &report.test_attempts, &report.test_scenes].into_iter().enumerate() {
            for (tag, value) in scalars(summary) {
                if let Some(value) = value {
                    self.scalar(set, tag, report.step, value)?;
                }
            }
        }
        self.begin_files_after((report.step, report.epoch));
        Ok(())
    }

    fn begin_files_after(&mut self, place: Place) {
        self.first = place;
        self.writers = [None, None, None];
    }

    fn scalar(&mut self, set: usize, tag: &str, step: u64, value: f64) -> io::Result<()> {
        let slot = &mut self.writers[set];
        let writer = if let Some(writer) = slot {
            writer
        } else {
            let folder = self.folder.join(SETS[set]);
            fs::create_dir_all(&folder)?;
            slot.insert(SummaryWriter::new(File::create(folder.join(file_name(self.first)))?)?)
        };
        writer.write_scalar(tag, step.cast_signed(), value as f32)
    }
}

/// Tags and values of an epoch.
fn scalars(summary: &Summary) -> [(&'static str, Option<f64>); 7] {
    [
        ("loss/epoch", Some(summary.loss)),
        ("loss/quality", Some(summary.loss_quality)),
        ("loss/rotation", Some(summary.loss_rotation)),
        ("loss/width", Some(summary.loss_width)),
        ("metrics/accuracy", summary.accuracy),
        ("metrics/precision", summary.precision),
        ("metrics/recall", summary.recall),
    ]
}

/// TensorBoard recognises event files by `tfevents` in their name and reads a folder's files in the order of names.
fn file_name((step, epochs): Place) -> String {
    format!("events.out.tfevents.{step:010}-{epochs:05}.graspmill")
}

fn first_of(name: &str) -> Option<Place> {
    let (step, epochs) = name.strip_prefix("events.out.tfevents.")?.strip_suffix(".graspmill")?.split_once('-')?;
    Some((step.parse().ok()?, epochs.parse().ok()?))
}

/// Removes event files that begin at this position or later; other files remain.
fn drop_later(folder: &Path, place: Place) -> io::Result<()> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(e),
    };
    for entry in entries {
        let entry = entry?;
        if first_of(&entry.file_name().to_string_lossy()).is_some_and(|first| first >= place) {
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// CRC-32C, bit by bit, masked as TFRecord does.
    fn masked_crc(bytes: &[u8]) -> u32 {
        let crc = bytes.iter().fold(!0_u32, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |crc, _| (crc >> 1) ^ (0x82f6_3b78 * (crc & 1)))
        });
        (!crc).rotate_right(15).wrapping_add(0xa282_ead8)
    }

    /// Records of a file: length, its checksum, bytes, their checksum.
    fn records(mut bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut records = Vec::new();
        while !bytes.is_empty() {
            let (length, rest) = bytes.split_at(8);
            let (length_crc, rest) = rest.split_at(4);
            let (record, rest) = rest.split_at(u64::from_le_bytes(length.try_into().unwrap()) as usize);
            let (record_crc, rest) = rest.split_at(4);
            assert_eq!(length_crc, masked_crc(length).to_le_bytes());
            assert_eq!(record_crc, masked_crc(record).to_le_bytes());
            records.push(record.to_vec());
            bytes = rest;
        }
        records
    }

    fn names(folder: &Path) -> Vec<Place> {
        let mut firsts: Vec<Place> = fs::read_dir(folder)
            .unwrap()
            .filter_map(|entry| first_of(&entry.unwrap().file_name().to_string_lossy()))
            .collect();
        firsts.sort_unstable();
        firsts
    }

    #[test]
    fn records_are_framed_as_tensorboard_reads_them() {
        assert_eq!(masked_crc(b"123456789"), 0xe306_9283_u32.rotate_right(15).wrapping_add(0xa282_ead8));
        let folder = tempfile::tempdir().unwrap();
        let mut events = Events::begin(folder.path(), 0, (0, 0)).unwrap();
        for step in 1..=20 {
            events.step(step, 0.5).unwrap();
        }
        let records = records(&fs::read(folder.path().join("train").join(file_name((0, 0)))).unwrap());
        assert_eq!(records.len(), 3);
        assert!(records[0].ends_with(b"brain.Event:2"));
        // Field 2 of an event is the step; a value holds its tag and, as field 2, the number.
        assert_eq!(records[2][9..11], [0x10, 20]);
        assert!(records[2].windows(9).any(|bytes| bytes == b"loss/step"));
        assert!(records[2].ends_with(&0.5_f32.to_le_bytes()));
    }

    #[test]
    fn who_goes_on_from_a_checkpoint_drops_what_came_after_it() {
        let folder = tempfile::tempdir().unwrap();
        let train = folder.path().join("train");
        let mut events = Events::begin(folder.path(), 20, (0, 0)).unwrap();
        for step in 1..=70 {
            events.step(step, 1.0).unwrap();
        }
        drop(events);
        assert_eq!(names(&train), [(0, 0), (20, 0), (40, 0), (60, 0)]);
        fs::write(train.join("notes.txt"), "mine").unwrap();
        let mut events = Events::begin(folder.path(), 20, (40, 0)).unwrap();
        assert_eq!(names(&train), [(0, 0), (20, 0)]);
        events.step(50, 1.0).unwrap();
        assert_eq!(names(&train), [(0, 0), (20, 0), (40, 0)]);
        assert_eq!(records(&fs::read(train.join(file_name((40, 0)))).unwrap()).len(), 2);
        Events::begin(folder.path(), 20, (0, 0)).unwrap();
        assert_eq!(names(&train), []);
        assert!(train.join("notes.txt").exists());
    }

    /// Epochs of 40 steps and a checkpoint every 20: an epoch's metrics follow the step of a checkpoint.
    #[test]
    fn an_epoch_is_kept_whatever_comes_after_it() {
        let folder = tempfile::tempdir().unwrap();
        let train = folder.path().join("train");
        let summary = crate::metrics::Tally::default().summary();
        let report = EpochReport {
            epoch: 1,
            step: 40,
            learning_rate: 1.0,
            train: summary,
            test_attempts: summary,
            test_scenes: summary,
            split_by: crate::config::SplitBy::Attempt,
            is_best: false,
            seconds: 0.0,
        };
        let epochs_kept = || {
            let files = names(&train).into_iter().map(|place| fs::read(train.join(file_name(place))).unwrap());
            files.filter(|file| file.windows(10).any(|bytes| bytes == b"loss/epoch")).count()
        };
        let mut events = Events::begin(folder.path(), 20, (0, 0)).unwrap();
        for step in 1..=40 {
            events.step(step, 1.0).unwrap();
        }
        events.epoch(&report).unwrap();
        events.step(50, 1.0).unwrap();
        assert_eq!(epochs_kept(), 1);
        // Stopped after the epoch: its events remain. Stopped before its end: the epoch is repeated.
        let mut events = Events::begin(folder.path(), 20, (40, 1)).unwrap();
        events.step(50, 1.0).unwrap();
        assert_eq!((epochs_kept(), names(&train)), (1, vec![(0, 0), (20, 0), (40, 0), (40, 1)]));
        let mut events = Events::begin(folder.path(), 20, (40, 0)).unwrap();
        assert_eq!(epochs_kept(), 0);
        events.epoch(&report).unwrap();
        events.step(50, 1.0).unwrap();
        assert_eq!((epochs_kept(), names(&train)), (1, vec![(0, 0), (20, 0), (40, 0), (40, 1)]));
    }
}
