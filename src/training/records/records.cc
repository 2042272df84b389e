#include "palpate/records/records.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdlib>

#include "palpate/base/file.h"
#include "palpate/base/learner.h"
#include "records/sqlite.h"

namespace palpate {
namespace {

// application id ("PaRc") and format in the file's header; every later version opens format 1
// (docs/reference/versions.md)
constexpr std::int64_t kApplication = 0x50615263, kFormat = 1;

// described in docs/guide/records.md
constexpr const char* kSchema = R"(
CREATE TABLE learners(id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE);
CREATE TABLE runs(id INTEGER PRIMARY KEY, learner INTEGER NOT NULL REFERENCES learners(id), task TEXT NOT NULL,
  task_hash TEXT NOT NULL, started_utc TEXT NOT NULL, data_set TEXT NOT NULL, palpate_version TEXT NOT NULL,
  commit_id TEXT NOT NULL, device TEXT NOT NULL, hand TEXT NOT NULL, settings_hash TEXT NOT NULL,
  run_hash TEXT NOT NULL, score_hash TEXT NOT NULL, duration_s REAL NOT NULL, in_a_row INTEGER NOT NULL,
  in_band INTEGER NOT NULL, UNIQUE(learner, task_hash, score_hash, started_utc));
CREATE INDEX runs_by_task ON runs(task, id);
CREATE TABLE metrics(run INTEGER NOT NULL REFERENCES runs(id), place INTEGER NOT NULL, name TEXT NOT NULL,
  unit TEXT NOT NULL, value REAL, at_least REAL, at_most REAL, counts INTEGER NOT NULL, in_band INTEGER NOT NULL,
  PRIMARY KEY(run, place)) WITHOUT ROWID;
)";

constexpr const char* kColumns =
    "runs.id, learners.name, task, task_hash, started_utc, data_set, palpate_version, commit_id, device, "
    "hand, "
    "settings_hash, run_hash, score_hash, duration_s, in_a_row, in_band FROM runs JOIN learners ON "
    "learners.id = "
    "runs.learner";

RunRecord run_of(const Statement& row) {
  RunRecord run;
  run.id = row.whole(0);
  int column = 1;
  for (std::string* text :
       {&run.learner, &run.task, &run.task_hash, &run.started_utc, &run.data_set, &run.palpate_version,
        &run.commit, &run.device, &run.hand, &run.settings_hash, &run.run_hash, &run.score_hash})
    *text = row.text(column++);
  run.duration_s = std::max(0.0, row.number(13).value_or(0));
  run.in_a_row = static_cast<int>(std::clamp<std::int64_t>(row.whole(14), 1, 100));
  run.in_band = row.whole(15) != 0;
  return run;
}

/// Rolls back in the destructor unless committed.
class Transaction {
 public:
  static Result<Transaction> begin(sqlite3* database, const std::filesystem::path& file) {
    // locks immediately, so that two writers wait for each other instead of failing half-way
    if (auto begun = execute(database, "BEGIN IMMEDIATE", file); !begun) return begun.error();
    return Transaction(database, file);
  }
  Transaction(Transaction&& other) noexcept
      : database_(std::exchange(other.database_, nullptr)), file_(std::move(other.file_)) {}
  Transaction& operator=(Transaction&&) = delete;
  ~Transaction() {
    if (database_) sqlite3_exec(database_, "ROLLBACK", nullptr, nullptr, nullptr);
  }
  Result<void> commit() {
    if (auto done = execute(database_, "COMMIT", file_); !done) return done;
    database_ = nullptr;
    return {};
  }

 private:
  Transaction(sqlite3* database, std::filesystem::path file) : database_(database), file_(std::move(file)) {}
  sqlite3* database_;
  std::filesystem::path file_;
};

class SqliteRecords final : public Records {
 public:
  SqliteRecords(std::unique_ptr<sqlite3, CloseDatabase> database, std::filesystem::path file)
      : database_(std::move(database)), file_(std::move(file)) {}

  Result<void> prepare(bool write);
  Result<std::int64_t> add(const RunRecord& run) override;
  Result<void> list(const RunFilter& filter,
                    const std::function<Result<void>(const RunRecord&)>& visit) override;
  Result<RunRecord> run(std::int64_t id) override;
  Result<Erased> erase(const std::string& learner) override;

 private:
  Result<Statement> statement(const char* sql) { return Statement::prepare(database_.get(), sql, file_); }
  Result<std::int64_t> number_of(const char* sql);
  Result<void> check_tables();
  Result<std::int64_t> learner_of(const std::string& name);
  Result<void> clean();

  std::unique_ptr<sqlite3, CloseDatabase> database_;
  std::filesystem::path file_;
};

Result<std::int64_t> SqliteRecords::number_of(const char* sql) {
  auto query = statement(sql);
  if (!query) return query.error();
  const auto row = query->step();
  if (!row) return row.error();
  return *row ? query->whole(0) : 0;
}

// the file is untrusted: only its rows may be read, and no trigger, view or function of it may run
Result<void> SqliteRecords::prepare(bool write) {
  sqlite3* const database = database_.get();
  constexpr int kWait_ms = 5000;
  sqlite3_busy_timeout(database, kWait_ms);
  sqlite3_db_config(database, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  sqlite3_db_config(database, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  sqlite3_db_config(database, SQLITE_DBCONFIG_ENABLE_TRIGGER, 0, nullptr);
  sqlite3_db_config(database, SQLITE_DBCONFIG_ENABLE_VIEW, 0, nullptr);
  sqlite3_limit(database, SQLITE_LIMIT_LENGTH, 1 << 20);
  if (auto done = execute(
          database, "PRAGMA cell_size_check = ON; PRAGMA temp_store = MEMORY; PRAGMA mmap_size = 0", file_);
      !done)
    return done;

  const auto tables = number_of("SELECT count(*) FROM sqlite_schema");
  if (!tables) return tables.error();
  if (*tables == 0 && write) {
    // WAL mode; deleted data is overwritten, and commits are synchronous
    if (auto done = execute(database, "PRAGMA journal_mode = WAL", file_); !done) return done;
    auto transaction = Transaction::begin(database, file_);
    if (!transaction) return transaction.error();
    const auto meanwhile = number_of("SELECT count(*) FROM sqlite_schema");
    if (!meanwhile) return meanwhile.error();
    if (*meanwhile == 0) {
      const std::string marks = "PRAGMA application_id = " + std::to_string(kApplication) +
                                "; PRAGMA user_version = " + std::to_string(kFormat);
      for (const char* sql : {kSchema, marks.c_str()})
        if (auto done = execute(database, sql, file_); !done) return done;
      if (auto done = transaction->commit(); !done) return done;
    }
  }
  if (auto checked = check_tables(); !checked) return checked;
  if (!write) return {};
  return execute(database, "PRAGMA secure_delete = ON; PRAGMA synchronous = FULL; PRAGMA foreign_keys = ON",
                 file_);
}

Result<void> SqliteRecords::check_tables() {
  const auto application = number_of("PRAGMA application_id");
  if (!application) return application.error();
  const auto format = number_of("PRAGMA user_version");
  if (!format) return format.error();
  if (*application != kApplication)
    return Error{ErrorKind::kBadInput, "this database does not hold palpate's records", file_.string(),
                 "give another file with --records"};
  if (*format > kFormat)
    return Error{ErrorKind::kBadInput,
                 "these records are of format " + std::to_string(*format) + ", newer than palpate",
                 file_.string(), "use the version of palpate that wrote them"};
  // the schema has to be exactly ours, in any order
  const auto plain = [](std::string text) {
    std::erase_if(text, [](char c) { return c == '\n' || c == ' '; });
    return text;
  };
  std::vector<std::string> made, there;
  const std::string schema = plain(kSchema);
  for (std::size_t at = 0; at < schema.size();) {
    const std::size_t end = schema.find(';', at);
    made.push_back(schema.substr(at, end - at));
    at = end + 1;
  }
  auto query = statement("SELECT sql FROM sqlite_schema WHERE sql IS NOT NULL");
  if (!query) return query.error();
  while (there.size() <= made.size()) {
    const auto row = query->step();
    if (!row) return row.error();
    if (!*row) break;
    there.push_back(plain(query->text(0)));
  }
  std::sort(made.begin(), made.end());
  std::sort(there.begin(), there.end());
  if (there != made)
    return Error{ErrorKind::kBadInput, "the tables of these records are not those of palpate", file_.string(),
                 "restore the last copy of the file"};
  return {};
}

Result<std::int64_t> SqliteRecords::learner_of(const std::string& name) {
  auto added = statement("INSERT INTO learners(name) VALUES(?1) ON CONFLICT(name) DO NOTHING");
  if (!added) return added.error();
  if (const auto done = added->bind(1, name).step(); !done) return done.error();
  auto query = statement("SELECT id FROM learners WHERE name = ?1");
  if (!query) return query.error();
  const auto row = query->bind(1, name).step();
  if (!row) return row.error();
  return query->whole(0);
}

Result<std::int64_t> SqliteRecords::add(const RunRecord& run) {
  if (auto checked = check_learner(run.learner); !checked) return checked.error();
  auto transaction = Transaction::begin(database_.get(), file_);
  if (!transaction) return transaction.error();
  const auto learner = learner_of(run.learner);
  if (!learner) return learner.error();
  {
    auto known = statement(
        "SELECT id FROM runs WHERE learner = ?1 AND task_hash = ?2 AND score_hash = ?3 AND started_utc = ?4");
    if (!known) return known.error();
    const auto row = known->bind(1, *learner)
                         .bind(2, run.task_hash)
                         .bind(3, run.score_hash)
                         .bind(4, run.started_utc)
                         .step();
    if (!row) return row.error();
    if (*row) return known->whole(0);
  }
  auto added = statement(
      "INSERT INTO runs(learner, task, task_hash, started_utc, data_set, palpate_version, commit_id, device, "
      "hand, "
      "settings_hash, run_hash, score_hash, duration_s, in_a_row, in_band) "
      "VALUES(?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15)");
  if (!added) return added.error();
  added->bind(1, *learner);
  int index = 2;
  for (const std::string* text :
       {&run.task, &run.task_hash, &run.started_utc, &run.data_set, &run.palpate_version, &run.commit,
        &run.device, &run.hand, &run.settings_hash, &run.run_hash, &run.score_hash})
    added->bind(index++, *text);
  added->bind(13, std::optional(run.duration_s))
      .bind(14, std::int64_t{run.in_a_row})
      .bind(15, std::int64_t{run.in_band});
  if (const auto done = added->step(); !done) return done.error();
  const std::int64_t id = sqlite3_last_insert_rowid(database_.get());

  auto metric = statement(
      "INSERT INTO metrics(run, place, name, unit, value, at_least, at_most, counts, in_band) "
      "VALUES(?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)");
  if (!metric) return metric.error();
  for (std::size_t n = 0; n < run.metrics.size(); ++n) {
    const RunMetric& m = run.metrics[n];
    metric->bind(1, id)
        .bind(2, static_cast<std::int64_t>(n))
        .bind(3, m.name)
        .bind(4, m.unit)
        .bind(5, m.value);
    metric->bind(6, m.at_least)
        .bind(7, m.at_most)
        .bind(8, std::int64_t{m.counts})
        .bind(9, std::int64_t{m.in_band});
    if (const auto done = metric->step(); !done) return done.error();
    metric->reset();
  }
  if (auto done = transaction->commit(); !done) return done.error();
  return id;
}

Result<void> SqliteRecords::list(const RunFilter& filter,
                                 const std::function<Result<void>(const RunRecord&)>& visit) {
  std::string where;
  if (!filter.learner.empty()) where += " WHERE learners.name = ?1";
  if (!filter.task.empty()) where += std::string(where.empty() ? " WHERE" : " AND") + " task = ?2";
  std::string sql = std::string("SELECT ") + kColumns + where + " ORDER BY runs.id";
  // the newest runs, in ascending order
  if (filter.newest > 0)
    sql = "SELECT * FROM (" + sql + " DESC LIMIT " + std::to_string(filter.newest) + ") ORDER BY 1";
  auto query = statement(sql.c_str());
  if (!query) return query.error();
  if (!filter.learner.empty()) query->bind(1, filter.learner);
  if (!filter.task.empty()) query->bind(2, filter.task);
  while (true) {
    const auto row = query->step();
    if (!row) return row.error();
    if (!*row) return {};
    if (auto used = visit(run_of(*query)); !used) return used;
  }
}

Result<RunRecord> SqliteRecords::run(std::int64_t id) {
  const std::string sql = std::string("SELECT ") + kColumns + " WHERE runs.id = ?1";
  auto query = statement(sql.c_str());
  if (!query) return query.error();
  const auto row = query->bind(1, id).step();
  if (!row) return row.error();
  if (!*row)
    return Error{ErrorKind::kBadInput, "there is no run " + std::to_string(id), file_.string(),
                 "palpate records list shows the runs"};
  RunRecord run = run_of(*query);
  auto metrics = statement(
      "SELECT name, unit, value, at_least, at_most, counts, in_band FROM metrics WHERE run = ?1 ORDER BY "
      "place");
  if (!metrics) return metrics.error();
  metrics->bind(1, id);
  while (true) {
    const auto next = metrics->step();
    if (!next) return next.error();
    if (!*next) return run;
    run.metrics.push_back({metrics->text(0), metrics->text(1), metrics->number(2), metrics->number(3),
                           metrics->number(4), metrics->whole(5) != 0, metrics->whole(6) != 0});
  }
}

// deleted data has been overwritten with zeros (secure_delete); the log is truncated, the file rebuilt
// without free pages, and the log that this went through truncated again
Result<void> SqliteRecords::clean() {
  const auto empty_log = [&]() -> Result<void> {
    int frames = 0, done = 0;
    const int code =
        sqlite3_wal_checkpoint_v2(database_.get(), nullptr, SQLITE_CHECKPOINT_TRUNCATE, &frames, &done);
    if (code != SQLITE_OK) return sqlite_error(code, sqlite3_errmsg(database_.get()), file_);
    return {};
  };
  if (auto emptied = empty_log(); !emptied) return emptied;
  if (auto done = execute(database_.get(), "VACUUM", file_); !done) return done;
  return empty_log();
}

Result<Erased> SqliteRecords::erase(const std::string& learner) {
  Erased erased;
  {
    auto transaction = Transaction::begin(database_.get(), file_);
    if (!transaction) return transaction.error();
    for (const char* sql : {"DELETE FROM metrics WHERE run IN (SELECT runs.id FROM runs JOIN learners ON "
                            "learners.id = runs.learner "
                            "WHERE learners.name = ?1)",
                            "DELETE FROM runs WHERE learner IN (SELECT id FROM learners WHERE name = ?1)",
                            "DELETE FROM learners WHERE name = ?1"}) {
      auto removal = statement(sql);
      if (!removal) return removal.error();
      if (const auto done = removal->bind(1, learner).step(); !done) return done.error();
      const std::int64_t changed = sqlite3_changes64(database_.get());
      if (std::string_view(sql).starts_with("DELETE FROM runs")) erased.runs = changed;
      if (std::string_view(sql).starts_with("DELETE FROM learners")) erased.was_known = changed > 0;
    }
    if (auto done = transaction->commit(); !done) return done.error();
  }
  // also if the learner is unknown: an earlier erasure may have been incomplete
  if (auto cleaned = clean(); !cleaned) {
    Error error = cleaned.error();
    error.what = "the runs are erased, but traces may remain in the file: " + error.what;
    error.remedy = "close other programs that have the records open, and erase the same learner again";
    return error;
  }
  return erased;
}

Result<std::unique_ptr<Records>> open_records(const std::filesystem::path& file, bool write) {
  // rejects a folder, a pipe or a device
  std::error_code unknown;
  if (!write || std::filesystem::exists(file, unknown))
    if (const auto opened = InputFile::open(file); !opened) return opened.error();
  // owner-only permissions, which SQLite's auxiliary files inherit
  if (write) {
    const int descriptor = ::open(file.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, S_IRUSR | S_IWUSR);
    if (descriptor < 0) return output_error(file, errno);
    ::close(descriptor);
  }
  sqlite3* database = nullptr;
  const int flags = (write ? SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE : SQLITE_OPEN_READWRITE) |
                    SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_EXRESCODE;
  // SQLite does not interpret an absolute path as a URI or an option
  const std::string name = std::filesystem::absolute(file).string();
  int code = sqlite3_open_v2(name.c_str(), &database, flags, nullptr);
  if (code != SQLITE_OK && !write) {
    sqlite3_close_v2(database);
    code = sqlite3_open_v2(name.c_str(), &database, SQLITE_OPEN_READONLY | SQLITE_OPEN_NOMUTEX, nullptr);
  }
  std::unique_ptr<sqlite3, CloseDatabase> owned(database);
  if (code != SQLITE_OK) return sqlite_error(code, database ? sqlite3_errmsg(database) : "no memory", file);
  auto records = std::make_unique<SqliteRecords>(std::move(owned), file);
  if (auto prepared = records->prepare(write); !prepared) return prepared.error();
  return std::unique_ptr<Records>(std::move(records));
}

}  // namespace

Result<std::unique_ptr<Records>> Records::open(const std::filesystem::path& file) {
  return open_records(file, true);
}

Result<std::unique_ptr<Records>> Records::open_to_read(const std::filesystem::path& file) {
  return open_records(file, false);
}

bool resembles_personal_name(const std::string& learner) {
  return learner.find_first_of("^@, ") != std::string::npos;
}

std::filesystem::path default_records_file() {
  const auto environment = [](const char* name) {
    const char* text = std::getenv(name);
    return std::filesystem::path(text ? text : "");
  };
  if (auto file = environment("PALPATE_RECORDS"); !file.empty()) return file;
  // the XDG specification requires relative paths to be ignored
  if (const auto data = environment("XDG_DATA_HOME"); data.is_absolute())
    return data / "palpate" / "records.db";
  if (const auto home = environment("HOME"); home.is_absolute())
    return home / ".local" / "share" / "palpate" / "records.db";
  return {};
}

}  // namespace palpate
