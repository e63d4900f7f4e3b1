//! Open sessions: owner, lifetime and limits.
//!
//! A session without requests for the idle time is closed; all sessions are closed when the server ends. Expired ones are removed
//! whenever a session is accessed, so that no timer is needed.

use crate::access::Caller;
use crate::problem::Problem;
use rotortwin_fdi_session::{Answer, Chunk, FdiSession, Refusal};
use rotortwin_links::zenoh::ZenohOptions;
use rotortwin_process::LinkAddress;
use rotortwin_scenario::Detectors;
use rotortwin_verdicts::view::{CalibrationState, ChangeView, ChunkAnswer, DetectorsView, ObstacleView, WindowView};
use rotortwin_zenoh::fdi_topic::TopicService;
use rotortwin_zenoh::topics::TopicSession;
use serde::Serialize;
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::watch;
use utoipa::ToSchema;

/// Verdict changes remembered per session.
const LONGEST_HISTORY: usize = 1000;

/// Limits of the service.
#[derive(Debug, Clone, Copy)]
pub struct FdiLimits {
    /// Maximum number of open sessions.
    pub sessions: usize,
    /// Maximum per tenant, if there are several.
    pub tenant_sessions: usize,
    /// Idle time after which a session is closed.
    pub idle: Duration,
}

impl Default for FdiLimits {
    fn default() -> Self {
        Self {
            sessions: 64,
            tenant_sessions: 16,
            idle: Duration::from_secs(600),
        }
    }
}

/// All of them.
#[derive(Debug)]
pub(crate) struct FdiSessions {
    limits: FdiLimits,
    open: Mutex<HashMap<String, Arc<Entry>>>,
    /// Processes that read a log or fly an effect while the caller waits: as many at the same time.
    pub(crate) reports: tokio::sync::Semaphore,
    link: Option<TopicSession>,
    /// Counts whatever happens to any session.
    news: Arc<watch::Sender<u64>>,
}

/// What is new of a caller's sessions.
#[derive(Debug)]
pub(crate) struct Changed {
    /// Sessions that were opened or fed, each with its version, ordered by id.
    pub(crate) changed: Vec<(u64, SessionView)>,
    /// Ids of those that are closed.
    pub(crate) gone: Vec<String>,
}

/// The connection for a link's address.
fn topics(address: &LinkAddress) -> Result<TopicSession, String> {
    let options = match address {
        LinkAddress::ZenohListen { endpoint, config: None } => ZenohOptions::listen(endpoint.clone()),
        LinkAddress::ZenohConnect { endpoint, config: None } => ZenohOptions::connect(endpoint.clone()),
        LinkAddress::ZenohListen { .. } | LinkAddress::ZenohConnect { .. } => {
            return Err(
                "--fdi-link: topics of FDI sessions have no access control yet; expected an endpoint without config=FILE, on a \
                 trusted network"
                    .to_owned(),
            );
        }
        LinkAddress::Iceoryx2 { .. } => {
            return Err(
                "--fdi-link: measurements do not come over iceoryx2; expected zenoh:listen=ENDPOINT or zenoh:connect=ENDPOINT"
                    .to_owned(),
            );
        }
    };
    TopicSession::open(&options).map_err(|error| format!("--fdi-link: {error}"))
}

/// One session.
#[derive(Debug)]
pub(crate) struct Entry {
    pub(crate) id: String,
    pub(crate) rotor_count: usize,
    tenant: String,
    detectors: DetectorsView,
    /// Shared with its topic.
    session: Arc<Mutex<FdiSession>>,
    history: Mutex<VecDeque<ChangeView>>,
    last_use: Mutex<Instant>,
    topic: Mutex<Option<TopicService>>,
    /// Chunks taken.
    version: AtomicU64,
    news: Arc<watch::Sender<u64>>,
}

/// A session and its state.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct SessionView {
    /// Id for URLs; cannot be guessed.
    id: String,
    /// The detectors in effect.
    detectors: DetectorsView,
    /// Expected samples per second.
    rate_hz: f64,
    /// Step at which the next chunk must begin; any before the first chunk.
    next_step: u64,
    /// Number of samples accepted.
    samples: u64,
    /// Progress of the calibration.
    calibration: CalibrationState,
    /// Step from which verdicts are given, unless a gap is too long.
    verdicts_from_step: u64,
    /// Number of samples with impossible values, ignored by the engine.
    rejected_samples: u64,
    /// Number of lost steps over which the engine extrapolated.
    bridged_steps: u64,
    /// Number of restarted calibrations: after longer gaps, on the ground or upset, after motion that the model does
    /// not explain.
    restarts: u64,
    /// Number of steps on the ground, just above it, or upset, in which the detectors paused.
    paused_steps: u64,
    /// Why there are no verdicts at present.
    cannot_judge: Option<ObstacleView>,
    /// The last window.
    last: Option<WindowView>,
    /// Changes of the sequential detector's verdict; the latest 1000.
    changes: Vec<ChangeView>,
    /// Idle time after which the session ends, s.
    idle_limit_s: f64,
}

impl SessionView {
    /// Name of the session.
    pub(crate) fn id(&self) -> &str {
        &self.id
    }
}

fn count(news: &watch::Sender<u64>) {
    news.send_modify(|number| *number = number.wrapping_add(1));
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Entry {
    /// Processes a chunk; returns the result and, if it is rejected, the expected step.
    pub(crate) fn feed(&self, chunk: &Chunk) -> Result<ChunkAnswer, (Refusal, u64)> {
        self.touch();
        let mut session = lock(&self.session);
        let answer = session.feed(chunk).map_err(|refusal| (refusal, session.next_step()))?;
        self.remember(&answer);
        Ok(ChunkAnswer::from(&answer))
    }

    /// Records verdict changes of a result.
    pub(crate) fn remember(&self, answer: &Answer) {
        self.touch();
        if answer.repeated {
            return;
        }
        let mut history = lock(&self.history);
        for window in &answer.windows {
            let change = ChangeView::of(window);
            let same = |last: &ChangeView| last.sequential.verdict == change.sequential.verdict;
            if !history.back().is_some_and(same) {
                history.push_back(change);
            }
            if history.len() > LONGEST_HISTORY {
                history.pop_front();
            }
        }
        drop(history);
        self.version.fetch_add(1, Ordering::Release);
        count(&self.news);
    }

    /// The session itself, for a stream of binary messages.
    pub(crate) fn session(&self) -> MutexGuard<'_, FdiSession> {
        self.touch();
        lock(&self.session)
    }

    /// The session, for feeding by a topic.
    pub(crate) fn shared(&self) -> Arc<Mutex<FdiSession>> {
        Arc::clone(&self.session)
    }

    /// Keeps the topic alive as long as the session.
    pub(crate) fn keep(&self, topic: TopicService) {
        *lock(&self.topic) = Some(topic);
    }

    fn touch(&self) {
        *lock(&self.last_use) = Instant::now();
    }

    fn is_idle(&self, limit: Duration) -> bool {
        lock(&self.last_use).elapsed() >= limit
    }
}

impl FdiSessions {
    /// * `link`: also accept measurements over zenoh
    ///
    /// # Errors
    /// The link cannot be opened.
    pub(crate) fn open_with(limits: FdiLimits, link: Option<&LinkAddress>) -> Result<Self, String> {
        Ok(Self {
            limits,
            open: Mutex::default(),
            reports: tokio::sync::Semaphore::new(2),
            link: link.map(topics).transpose()?,
            news: Arc::new(watch::Sender::new(0)),
        })
    }

    /// Changes whenever a session is opened, fed or closed; not when one ends because it is idle.
    pub(crate) fn watch(&self) -> watch::Receiver<u64> {
        self.news.subscribe()
    }

    /// Changes of the caller's sessions since `told`: ids, and the version of each. Looking keeps none alive.
    pub(crate) fn changed_since(&self, caller: &Caller, told: &BTreeMap<String, u64>) -> Changed {
        let entries = self.of(caller);
        let open = |id: &String| entries.binary_search_by(|entry| entry.id.cmp(id)).is_ok();
        let gone = told.keys().filter(|id| !open(id)).cloned().collect();
        let mut changed = Vec::new();
        for entry in &entries {
            // Read before the session: a chunk that arrives in between is reported again.
            let version = entry.version.load(Ordering::Acquire);
            if told.get(&entry.id) != Some(&version) {
                changed.push((version, self.look_at(entry)));
            }
        }
        Changed { changed, gone }
    }

    /// True if sessions can be fed over zenoh.
    pub(crate) fn has_link(&self) -> bool {
        self.link.is_some()
    }

    /// Also feeds a session over zenoh.
    ///
    /// # Errors
    /// 500: zenoh fails.
    pub(crate) fn give_topic(&self, entry: &Arc<Entry>) -> Result<(), Problem> {
        let link = self
            .link
            .as_ref()
            .ok_or_else(|| Problem::internal(&"there is no link"))?;
        // The topic must not keep its own session alive.
        let weak = Arc::downgrade(entry);
        let topic = TopicService::start(link, &entry.id, entry.shared(), move |answer| {
            if let (Some(entry), Ok(answer)) = (weak.upgrade(), answer) {
                entry.remember(answer);
            }
        })
        .map_err(|error| Problem::internal(&error))?;
        entry.keep(topic);
        Ok(())
    }

    /// Maximum idle time of a session.
    pub(crate) fn idle(&self) -> Duration {
        self.limits.idle
    }

    /// Opens one. Each tenant has its share, so that one client cannot use up all sessions; without tokens there is a single tenant,
    /// whose share is all.
    ///
    /// # Errors
    /// 429 if the tenant's share is used up, 503 if others use the rest; 422 if the engine rejects its configuration.
    pub(crate) fn open(&self, caller: &Caller, detectors: &Detectors) -> Result<Arc<Entry>, Problem> {
        let number = rand::random::<u64>().max(1);
        let session =
            FdiSession::new(*detectors.config(), number).map_err(|error| Problem::unprocessable(error.to_string()))?;
        let mut open = lock(&self.open);
        self.sweep(&mut open);
        let idle_s = self.limits.idle.as_secs_f64();
        let own = open.values().filter(|entry| entry.tenant == caller.tenant).count();
        let (share, option) = if caller.is_one_of_several {
            (self.limits.tenant_sessions, "--tenant-fdi-sessions")
        } else {
            (self.limits.sessions, "--fdi-sessions")
        };
        if own >= share {
            return Err(Problem::too_many(format!(
                "'{}' has {own} FDI sessions open, the limit per tenant (`{option}`); delete one, or wait until one ends after {idle_s} s \
                 of silence",
                caller.tenant
            )));
        }
        if open.len() >= self.limits.sessions {
            return Err(Problem::unavailable(format!(
                "{} FDI sessions are open, the limit of this server; delete one, or wait until one ends after {idle_s} s of silence",
                open.len()
            )));
        }
        let entry = Arc::new(Entry {
            id: format!("{number:016x}{:016x}", rand::random::<u64>()),
            rotor_count: session.rotor_count(),
            tenant: caller.tenant.clone(),
            detectors: detectors.into(),
            session: Arc::new(Mutex::new(session)),
            history: Mutex::default(),
            last_use: Mutex::new(Instant::now()),
            topic: Mutex::default(),
            version: AtomicU64::new(0),
            news: Arc::clone(&self.news),
        });
        open.insert(entry.id.clone(), Arc::clone(&entry));
        drop(open);
        count(&self.news);
        Ok(entry)
    }

    /// The session with this id. Other tenants' sessions appear not to exist.
    ///
    /// # Errors
    /// 404.
    pub(crate) fn get(&self, caller: &Caller, id: &str) -> Result<Arc<Entry>, Problem> {
        let mut open = lock(&self.open);
        self.sweep(&mut open);
        let his = |entry: &&Arc<Entry>| caller.sees_all || entry.tenant == caller.tenant;
        open.get(id).filter(his).cloned().ok_or_else(|| {
            Problem::not_found(format!(
                "FDI session '{id}' not found; sessions end after {} s of silence and when the server stops",
                self.limits.idle.as_secs_f64()
            ))
        })
    }

    /// Closes one.
    ///
    /// # Errors
    /// 404.
    pub(crate) fn close(&self, caller: &Caller, id: &str) -> Result<Arc<Entry>, Problem> {
        let entry = self.get(caller, id)?;
        lock(&self.open).remove(id);
        count(&self.news);
        Ok(entry)
    }

    /// True if a session is still open.
    pub(crate) fn has(&self, id: &str) -> bool {
        let mut open = lock(&self.open);
        self.sweep(&mut open);
        open.contains_key(id)
    }

    /// The caller's current sessions, ordered by id. Listing does not keep them alive.
    pub(crate) fn list(&self, caller: &Caller) -> Vec<SessionView> {
        self.of(caller).iter().map(|entry| self.look_at(entry)).collect()
    }

    fn of(&self, caller: &Caller) -> Vec<Arc<Entry>> {
        let mut open = lock(&self.open);
        self.sweep(&mut open);
        let mut entries: Vec<Arc<Entry>> = open.values().cloned().collect();
        drop(open);
        entries.retain(|entry| caller.sees_all || entry.tenant == caller.tenant);
        entries.sort_by(|a, b| a.id.cmp(&b.id));
        entries
    }

    /// The current state of a session.
    pub(crate) fn view(&self, entry: &Entry) -> SessionView {
        entry.touch();
        self.look_at(entry)
    }

    fn look_at(&self, entry: &Entry) -> SessionView {
        let session = lock(&entry.session);
        SessionView {
            id: entry.id.clone(),
            detectors: entry.detectors.clone(),
            rate_hz: 1.0 / session.period_s(),
            next_step: session.next_step(),
            samples: session.samples(),
            calibration: session.calibration().into(),
            verdicts_from_step: session.verdicts_from_step(),
            rejected_samples: session.rejected_samples(),
            bridged_steps: session.bridged_steps(),
            restarts: session.restarts(),
            paused_steps: session.paused_steps(),
            cannot_judge: session.obstacle().as_ref().map(ObstacleView::from),
            last: session.last().map(WindowView::from),
            changes: lock(&entry.history).iter().cloned().collect(),
            idle_limit_s: self.limits.idle.as_secs_f64(),
        }
    }

    fn sweep(&self, open: &mut HashMap<String, Arc<Entry>>) {
        open.retain(|_, entry| !entry.is_idle(self.limits.idle));
    }
}
