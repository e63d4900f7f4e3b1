//! The database with a time-out around every call.
//!
//! A silently broken network connection leaves a statement without a response, and the connection open: callers would wait until the kernel
//! gives up, after a quarter of an hour or never. So the database is only accessed through [`TimedPool`] and [`Transaction`], which time
//! out after [`CALL`]. The pool then closes the connection, as its state is unknown.

use futures_util::future::BoxFuture;
use futures_util::stream::{self, BoxStream};
use futures_util::{FutureExt as _, StreamExt as _};
use sqlx::any::{AnyQueryResult, AnyRow, AnyStatement, AnyTypeInfo};
use sqlx::{Any, AnyPool, Either, Error, Execute, Executor, SqlStr};
use std::future::Future;
use std::ops::{Deref, DerefMut};
use std::time::Duration;

/// Time limit of a call: the next row, the end of a statement, a commit. Longer than the database's own limits, whose error messages are
/// more specific.
const CALL: Duration = Duration::from_secs(20);

type Step = Result<Either<AnyQueryResult, AnyRow>, Error>;

/// A call's result, or an error if it takes too long.
async fn within<T>(call: impl Future<Output = Result<T, Error>>) -> Result<T, Error> {
    tokio::time::timeout(CALL, call).await.unwrap_or_else(|_| Err(late()))
}

fn late() -> Error {
    let told = format!("the database did not answer within {} s", CALL.as_secs());
    Error::Io(std::io::Error::new(std::io::ErrorKind::TimedOut, told))
}

/// A stream that ends with an error if the next item takes too long.
fn steps_within<'e>(steps: BoxStream<'e, Step>) -> BoxStream<'e, Step> {
    stream::unfold(Some(steps), |steps| async move {
        let mut steps = steps?;
        match tokio::time::timeout(CALL, steps.next()).await {
            Ok(step) => Some((step?, Some(steps))),
            Err(_) => Some((Err(late()), None)),
        }
    })
    .boxed()
}

/// Connections to the database.
#[derive(Debug, Clone)]
pub(crate) struct TimedPool(AnyPool);

impl TimedPool {
    pub(super) fn new(pool: AnyPool) -> Self {
        Self(pool)
    }

    /// For operations with their own limits: migrations, backups.
    pub(super) fn untimed(&self) -> &AnyPool {
        &self.0
    }

    /// Begins a transaction.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn begin(&self) -> Result<Transaction, Error> {
        let begun = within(self.0.begin()).await?;
        Ok(Transaction(TimedConnection(begun)))
    }
}

impl<'p> Executor<'p> for &'p TimedPool {
    type Database = Any;

    fn fetch_many<'e, 'q: 'e, E>(self, query: E) -> BoxStream<'e, Step>
    where
        'p: 'e,
        E: 'q + Execute<'q, Any>,
    {
        steps_within(Executor::fetch_many(&self.0, query))
    }

    fn fetch_optional<'e, 'q: 'e, E>(self, query: E) -> BoxFuture<'e, Result<Option<AnyRow>, Error>>
    where
        'p: 'e,
        E: 'q + Execute<'q, Any>,
    {
        within(Executor::fetch_optional(&self.0, query)).boxed()
    }

    fn prepare_with<'e>(self, sql: SqlStr, parameters: &'e [AnyTypeInfo]) -> BoxFuture<'e, Result<AnyStatement, Error>>
    where
        'p: 'e,
    {
        within(Executor::prepare_with(&self.0, sql, parameters)).boxed()
    }
}

/// A transaction; rolled back if dropped before it is committed.
#[derive(Debug)]
pub(crate) struct Transaction(TimedConnection);

impl Transaction {
    /// Commits.
    ///
    /// # Errors
    /// The database. It is unknown then whether the transaction was committed.
    pub(crate) async fn commit(self) -> Result<(), Error> {
        within(self.0.0.commit()).await
    }
}

impl Deref for Transaction {
    type Target = TimedConnection;

    fn deref(&self) -> &TimedConnection {
        &self.0
    }
}

impl DerefMut for Transaction {
    fn deref_mut(&mut self) -> &mut TimedConnection {
        &mut self.0
    }
}

/// What statements of a transaction run on.
#[derive(Debug)]
pub(crate) struct TimedConnection(sqlx::Transaction<'static, Any>);

impl<'c> Executor<'c> for &'c mut TimedConnection {
    type Database = Any;

    fn fetch_many<'e, 'q: 'e, E>(self, query: E) -> BoxStream<'e, Step>
    where
        'c: 'e,
        E: 'q + Execute<'q, Any>,
    {
        steps_within(Executor::fetch_many(&mut *self.0, query))
    }

    fn fetch_optional<'e, 'q: 'e, E>(self, query: E) -> BoxFuture<'e, Result<Option<AnyRow>, Error>>
    where
        'c: 'e,
        E: 'q + Execute<'q, Any>,
    {
        within(Executor::fetch_optional(&mut *self.0, query)).boxed()
    }

    fn prepare_with<'e>(self, sql: SqlStr, parameters: &'e [AnyTypeInfo]) -> BoxFuture<'e, Result<AnyStatement, Error>>
    where
        'c: 'e,
    {
        within(Executor::prepare_with(&mut *self.0, sql, parameters)).boxed()
    }
}
