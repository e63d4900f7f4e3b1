//! Shards of a campaign in an object store: written by flights, and read for a merge.
//!
//! ```text
//!  campaign --shards 0..4 --out s3://B/P ─┐                                   ┌─▶ campaign merge C s3://B/P --out DIR
//!  campaign --shards 4..9 --out s3://B/P ─┴─▶ P/campaign.json, P/shards/000000.parquet, … ─┘
//! ```
//! `campaign merge C s3://B/P --out s3://B/Q` puts the table of results, the summary and the report there, for `rotortwin query`.
//!
//! As in a folder, a shard appears whole or not at all, and existing shards are not flown. Several processes may fly the same shard: each
//! writes it only if it does not exist (`If-None-Match: *`), and otherwise compares its bytes with the existing one.

use rotortwin_api::Bucket;
use rotortwin_campaign::study::engine::OneByOne;
use rotortwin_campaign::study::folder::{CampaignFolder, MANIFEST, check_manifest, manifest, shard_name, shard_number};
use rotortwin_campaign::study::merge::{different, take_in_shard};
use rotortwin_campaign::study::results::{CSV_FILE, PARQUET_FILE, REPORT_FILE, SUMMARY_FILE};
use rotortwin_campaign::study::{Campaign, runner};
use rotortwin_cli::campaign::{FlightArgs, Store, fly_shards};
use rotortwin_runner::campaign::prepare_in;
use rotortwin_runner::failure::Failure;
use std::collections::BTreeSet;
use std::process::ExitCode;
use tokio::runtime::Runtime;

/// S3-compatible stores.
pub(crate) struct Buckets;

impl Store for Buckets {
    fn fly(&self, args: &FlightArgs, address: &str, campaign: &Campaign) -> Result<ExitCode, Failure> {
        let place = Place::open(address)?;
        place.claim(campaign)?;
        let present = place.shards()?;
        let work = tempfile::Builder::new()
            .prefix("rotortwin-shards-")
            .tempdir()
            .map_err(|error| {
                Failure::Failed(format!("a temporary folder for the shards cannot be created: {error}"))
            })?;
        let folder = CampaignFolder::open(&work.path().join("campaign"), campaign).map_err(Failure::Failed)?;
        place.check_same_program(campaign, &folder, &present)?;
        let prepared = prepare_in(&args.job(campaign), campaign, folder, present);
        let folder = prepared.folder();
        let keep = |shard: u64| {
            let content = folder.shard_bytes(shard)?;
            let there = place
                .create(&shard_name(shard), content.clone())
                .map_err(|failure| failure.to_string())?;
            match there {
                Some(there) if there != content => Err(different(address, "this program's", shard)),
                _ => folder.drop_shard(shard),
            }
        };
        fly_shards(args, &prepared, address, &keep)
    }

    fn take_in(&self, into: &CampaignFolder, address: &str, campaign: &Campaign) -> Result<(), Failure> {
        let place = Place::open(address)?;
        let found = place.wait(place.bucket.read(MANIFEST))?.ok_or_else(|| {
            Failure::Input(format!(
                "{address}: expected what 'rotortwin campaign --shards … --out {address}' has written, it has no {MANIFEST}"
            ))
        })?;
        check_manifest(address, &found, campaign).map_err(Failure::Input)?;
        let keys = place
            .shards()?
            .into_iter()
            .filter(|shard| *shard < into.shard_count())
            .map(|shard| (shard_name(shard), shard));
        let taken = place.bucket.read_all(keys, |shard, content| {
            take_in_shard(into, address, shard, &content)
                .map(drop)
                .map_err(Refused::Shard)
        });
        place.runtime.block_on(taken).map_err(|refused| match refused {
            Refused::Store(error) => place.unanswered(&error),
            Refused::Shard(sentence) => Failure::Input(sentence),
        })
    }

    fn keep(&self, from: &CampaignFolder, address: &str, campaign: &Campaign) -> Result<(), Failure> {
        let place = Place::open(address)?;
        place.claim(campaign)?;
        for name in [PARQUET_FILE, CSV_FILE, SUMMARY_FILE, REPORT_FILE] {
            let path = from.path().join(name);
            let content =
                std::fs::read(&path).map_err(|error| Failure::Failed(format!("{}: {error}", path.display())))?;
            if place
                .create(name, content.clone())?
                .is_some_and(|there| there != content)
            {
                return Err(Failure::Input(format!(
                    "{address}/{name}: expected the bytes of this program's result; another version of it wrote there"
                )));
            }
        }
        Ok(())
    }
}

/// Why a shard was not accepted.
enum Refused {
    Store(std::io::Error),
    Shard(String),
}

impl From<std::io::Error> for Refused {
    fn from(error: std::io::Error) -> Self {
        Self::Store(error)
    }
}

/// An address, and the client for its store.
struct Place<'a> {
    address: &'a str,
    bucket: Bucket,
    runtime: Runtime,
}

impl<'a> Place<'a> {
    fn open(address: &'a str) -> Result<Self, Failure> {
        // For TLS; an error means that a provider is already installed.
        let _chosen = rustls::crypto::ring::default_provider().install_default();
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .enable_all()
            .build()
            .map_err(|error| Failure::Failed(format!("the network cannot be used: {error}")))?;
        Ok(Self {
            address,
            bucket: Bucket::open(address).map_err(Failure::Input)?,
            runtime,
        })
    }

    fn wait<T>(&self, asked: impl Future<Output = std::io::Result<T>>) -> Result<T, Failure> {
        self.runtime.block_on(asked).map_err(|error| self.unanswered(&error))
    }

    fn unanswered(&self, error: &std::io::Error) -> Failure {
        Failure::Failed(format!("{}: {error}", self.address))
    }

    /// `None`: created; otherwise the existing object.
    fn create(&self, key: &str, content: Vec<u8>) -> Result<Option<Vec<u8>>, Failure> {
        self.wait(self.bucket.create(key, content))
    }

    /// Makes the place one of this campaign, or checks that it is.
    fn claim(&self, campaign: &Campaign) -> Result<(), Failure> {
        let text = manifest(campaign).map_err(Failure::Input)?;
        match self.create(MANIFEST, text.into_bytes())? {
            Some(there) => check_manifest(self.address, &there, campaign).map_err(Failure::Input),
            None => Ok(()),
        }
    }

    fn shards(&self) -> Result<BTreeSet<u64>, Failure> {
        let names = self.wait(self.bucket.names())?;
        Ok(names.iter().filter_map(|name| shard_number(name)).collect())
    }

    /// Like [`runner::check_same_program`], for shards in the store.
    fn check_same_program(
        &self,
        campaign: &Campaign,
        folder: &CampaignFolder,
        present: &BTreeSet<u64>,
    ) -> Result<(), Failure> {
        let ends: BTreeSet<u64> = present.first().into_iter().chain(present.last()).copied().collect();
        for shard in &ends {
            let name = shard_name(*shard);
            if let Some(content) = self.wait(self.bucket.read(&name))? {
                let from = format!("{}/{name}", self.address);
                folder.put_shard(*shard, &content, &from).map_err(Failure::Input)?;
            }
        }
        runner::check_same_program(campaign, &OneByOne, folder, self.address).map_err(Failure::Input)?;
        for shard in ends.into_iter().filter(|shard| folder.has_shard(*shard)) {
            folder.drop_shard(shard).map_err(Failure::Failed)?;
        }
        Ok(())
    }
}
