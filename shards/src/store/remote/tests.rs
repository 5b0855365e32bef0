//! Tests with an object store in memory; tests/python/test_stores.py uses a real one.

use std::collections::BTreeMap;

use object_store::memory::InMemory;
use program::{ExitCode, Failure};

use super::*;
use crate::store::fault::Kind;
use crate::store::storage::Storage;
use crate::synthetic;
use crate::{Dataset, DatasetInfo, Draft, Finalized, ShardSummary};

fn info() -> DatasetInfo {
    let mut info = synthetic::info(5, 2, 40, 8);
    info.grid.resolution = 4;
    info
}

fn storage(store: &Arc<InMemory>, prefix: &str, fault: Fault) -> Storage {
    let url = Url::parse(&format!("s3://bucket/{prefix}")).unwrap();
    let remote = Remote::new(&url, Arc::clone(store) as _, true, Path::from(prefix)).unwrap();
    Storage::Remote(Arc::new(remote.with_fault(fault)))
}

#[test]
fn a_listing_has_files_and_folders_and_one_without_end_is_refused() {
    let store = bucket();
    let listing = storage(&store, "sets/one", Fault::default()).list("").unwrap().unwrap();
    let folders: Vec<&str> = listing.iter().filter(|(_, size)| size.is_none()).map(|(name, _)| name.as_str()).collect();
    assert_eq!((listing.len(), &folders[..]), (6, &["attempts", "meta", "objects", "scenes"][..]));
    let folder = Path::from("sets/one");
    let runtime = Builder::new_current_thread().build().unwrap();
    let object = runtime.block_on(store.head(&folder.clone().join("_SUCCESS"))).unwrap();
    let endless = futures_util::stream::iter(std::iter::repeat_with(|| Ok(object.clone())));
    assert_eq!(runtime.block_on(listed(endless, &folder)).unwrap_err().kind(), io::ErrorKind::InvalidInput);
}

fn draft(store: &Arc<InMemory>, fault: Fault) -> Draft {
    Draft::begin_in(storage(store, "sets/one", fault), &info()).unwrap()
}

fn write(draft: &Draft, shard: u32) -> Result<ShardSummary, Failure> {
    let mut writer = draft.shard(shard)?;
    for scene in draft.info().scenes_of(shard) {
        writer.push(&synthetic::scene_rows(scene, draft.info().seed, draft.info()))?;
    }
    writer.commit()
}

/// A bucket with a dataset of 2 shards under a prefix.
fn bucket() -> Arc<InMemory> {
    let store = Arc::new(InMemory::new());
    let draft = draft(&store, Fault::default());
    for shard in 0..2 {
        write(&draft, shard).unwrap();
    }
    assert!(matches!(draft.finalize().unwrap(), Finalized::Complete(_)));
    store
}

/// Every object with its bytes.
fn objects(store: &InMemory) -> BTreeMap<String, Vec<u8>> {
    let runtime = Builder::new_current_thread().build().unwrap();
    runtime.block_on(async {
        let mut found = BTreeMap::new();
        let mut listed = store.list(None);
        while let Some(object) = listed.next().await {
            let path = object.unwrap().location;
            found.insert(path.to_string(), store.get(&path).await.unwrap().bytes().await.unwrap().to_vec());
        }
        found
    })
}

fn open(store: &Arc<InMemory>, prefix: &str) -> Result<Dataset, Failure> {
    let dataset = Dataset::of_storage(storage(store, prefix, Fault::default()))?;
    dataset.look_at_sizes()?;
    Ok(dataset)
}

const FILE: &str = "attempts/shard-00001-of-00002.parquet";

#[test]
fn what_is_in_a_bucket_is_read() {
    let store = bucket();
    let dataset = open(&store, "sets/one").unwrap();
    let info = info();
    let rows = info.scenes_of(1).map(|scene| synthetic::scene_rows(scene, info.seed, &info));
    assert!(dataset.rows(1, true).unwrap().map(Result::unwrap).eq(rows));
    assert_eq!(dataset.storage.list("scenes").unwrap().unwrap().len(), 2);
    assert_eq!(open(&store, "sets/two").unwrap_err().exit_code(), ExitCode::Config);
}

#[test]
fn sizes_are_seen_when_it_is_opened_and_checksums_when_it_is_read() {
    let store = bucket();
    let path = Path::from(format!("sets/one/{FILE}"));
    let runtime = Builder::new_current_thread().build().unwrap();
    let put = |bytes: Vec<u8>| runtime.block_on(store.put(&path, bytes.into())).map(drop).unwrap();
    let whole = runtime.block_on(async { store.get(&path).await.unwrap().bytes().await.unwrap().to_vec() });
    let mut flipped = whole.clone();
    flipped[20] ^= 4;
    put(flipped);
    let told = open(&store, "sets/one").unwrap().rows(1, false).map(drop).unwrap_err();
    let (code, told) = (told.exit_code(), told.to_string());
    assert!(code == ExitCode::Data && told.starts_with("shard 1: sha256 must be ") && told.ends_with(FILE), "{told}");
    put(whole[..9].to_vec());
    let told = open(&store, "sets/one").unwrap_err().to_string();
    assert!(told.starts_with("shard 1: size must be ") && told.ends_with(FILE), "{told}");
    runtime.block_on(store.delete(&path)).unwrap();
    let told = open(&store, "sets/one").unwrap_err().to_string();
    assert!(told.starts_with("shard 1: the file is missing: ") && told.ends_with(FILE), "{told}");
}

#[test]
fn a_bucket_holds_the_bytes_that_a_folder_would() {
    let dir = tempfile::tempdir().unwrap();
    let here = Draft::begin(dir.path(), &info()).unwrap();
    for shard in 0..2 {
        write(&here, shard).unwrap();
    }
    here.finalize().unwrap();
    let objects = objects(&bucket());
    assert_eq!(objects.len(), 1 + 2 + 6 + 3);
    for (name, bytes) in objects {
        assert_eq!(std::fs::read(dir.path().join(name.trim_start_matches("sets/one/"))).unwrap(), bytes, "{name}");
    }
}

#[test]
fn whichever_answer_is_lost_and_whichever_put_fails_the_bytes_are_the_same_in_the_end() {
    let expected = objects(&bucket());
    for kind in [Kind::LoseAnswer, Kind::Fail] {
        let mut faults = 0;
        for puts in 0.. {
            let store = Arc::new(InMemory::new());
            let work = |fault: Fault| {
                let draft = draft(&store, Fault::default());
                let faulty = Draft { storage: storage(&store, "sets/one", fault), ..draft };
                for shard in faulty.missing().unwrap() {
                    write(&faulty, shard).map_err(|e| e.exit_code())?;
                }
                faulty.finalize().map_err(|e| e.exit_code())
            };
            let ended = work(Fault::after(puts, kind));
            match kind {
                Kind::LoseAnswer => assert!(ended.is_ok(), "an answer lost at put {puts}: {ended:?}"),
                _ => assert!(ended.is_ok() || ended == Err(ExitCode::TryAgain), "{ended:?}"),
            }
            work(Fault::default()).unwrap();
            assert!(objects(&store) == expected, "{kind:?} at put {puts}");
            if puts == expected.len() as u64 {
                assert!(ended.is_ok());
                break;
            }
            faults += 1;
        }
        assert!(faults >= 10, "{faults} faults");
    }
}

#[test]
fn writers_of_the_same_shards_at_once_agree_and_one_that_differs_is_refused() {
    let store = Arc::new(InMemory::new());
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                let draft = draft(&store, Fault::default());
                for shard in 0..2 {
                    write(&draft, shard).unwrap();
                }
                draft.finalize().unwrap();
            });
        }
    });
    let expected = objects(&bucket());
    assert!(objects(&store) == expected);

    let differs = Draft { info: DatasetInfo { seed: 6, ..info() }, ..draft(&store, Fault::default()) };
    let runtime = Builder::new_current_thread().build().unwrap();
    let marker = Path::from("sets/one/meta/shards/00000.json");
    runtime.block_on(store.delete(&marker)).unwrap();
    let error = write(&differs, 0).unwrap_err();
    assert_eq!(error.exit_code(), ExitCode::Data, "{error}");
    assert_eq!(draft(&store, Fault::default()).missing().unwrap(), [0]);
    write(&draft(&store, Fault::default()), 0).unwrap();
    assert!(objects(&store) == expected, "the first one's files were kept");
}

#[test]
fn another_dataset_or_a_strange_object_is_left_alone() {
    let store = bucket();
    let before = objects(&store);
    let begin = |prefix: &str, seed| {
        let info = DatasetInfo { seed, ..info() };
        Draft::begin_in(storage(&store, prefix, Fault::default()), &info).unwrap_err()
    };
    for (prefix, seed, part) in [("sets/one", 6, "seed (5 there, 6 asked for)"), ("sets", 5, "\"one\"")] {
        let error = begin(prefix, seed);
        assert!(error.exit_code() == ExitCode::Config && error.to_string().contains(part), "{error}");
    }
    assert!(objects(&store) == before);
}

#[test]
fn a_web_server_is_no_place_to_write() {
    let url = Url::parse("http://127.0.0.1:9/set").unwrap();
    let error = Draft::begin(place(&url), &info()).unwrap_err();
    assert!(error.exit_code() == ExitCode::Config && error.to_string().contains("a web server takes no"), "{error}");
}
