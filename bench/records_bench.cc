/// Duration of listing many runs, compared with the same query through SQLite directly.
#include <sqlite3.h>
#include <stdlib.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <vector>

#include "json_file.h"
#include "palpate/base/check.h"
#include "palpate/records/records.h"

namespace palpate::bench {
namespace {

double seconds_of(const auto& work) {
  const auto begin = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

void run_sql(sqlite3* database, const std::string& sql) {
  PALPATE_CHECK(sqlite3_exec(database, sql.c_str(), nullptr, nullptr, nullptr) == SQLITE_OK);
}

/// 20 learners, 5 tasks, 8 metrics per run; in one transaction, because add() flushes each run to the disk.
void fill(const std::filesystem::path& file, int runs) {
  { PALPATE_CHECK(Records::open(file).ok()); }
  sqlite3* database = nullptr;
  PALPATE_CHECK(sqlite3_open(file.c_str(), &database) == SQLITE_OK);
  const std::string count = std::to_string(runs);
  run_sql(database,
          "BEGIN; WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 20) "
          "INSERT INTO learners SELECT i, printf('L%03d', i) FROM n");
  run_sql(
      database,
      "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < " + count +
          ") INSERT INTO runs SELECT i, 1 + i % 20, printf('Task %d', i % 5), printf('%016x', i % 5), "
          "'2026-01-02T03:04:05Z', 'knee-phantom:seed=3', '0.1.0', 'abcdef0', 'premium-1.5', 'firm-grip', "
          "'0123456789abcdef', printf('%016x', i), printf('%016x', i), 12.5 + i % 60, 3, i % 3 = 0 FROM n");
  run_sql(database, "WITH RECURSIVE n(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n WHERE i < 8 * " + count +
                        " - 1) INSERT INTO metrics SELECT 1 + i / 8, i % 8, printf('metric %d', i % 8), 'N', "
                        "i * 0.1, NULL, "
                        "8.5, 1, 1 FROM n; COMMIT");
  sqlite3_close(database);
}

/// The rows of list() with all columns read, without conversion.
std::size_t bare(sqlite3* database) {
  constexpr const char* kSql =
      "SELECT runs.id, learners.name, task, task_hash, started_utc, data_set, palpate_version, commit_id, "
      "device, hand, "
      "settings_hash, run_hash, score_hash, duration_s, in_a_row, in_band FROM runs JOIN learners ON "
      "learners.id = "
      "runs.learner ORDER BY runs.id";
  sqlite3_stmt* statement = nullptr;
  PALPATE_CHECK(sqlite3_prepare_v2(database, kSql, -1, &statement, nullptr) == SQLITE_OK);
  std::size_t bytes = 0;
  while (sqlite3_step(statement) == SQLITE_ROW) {
    for (int column = 1; column < 13; ++column) {
      PALPATE_CHECK(sqlite3_column_text(statement, column) != nullptr);
      bytes += static_cast<std::size_t>(sqlite3_column_bytes(statement, column));
    }
    bytes += static_cast<std::size_t>(sqlite3_column_int64(statement, 0) != 0);
  }
  sqlite3_finalize(statement);
  return bytes;
}

int run(int argc, char** argv) {
  CLI::App app("Lists many runs, and steps through the same rows by SQLite alone, in turns");
  int runs = 100000, rounds = 9;
  std::string json_file;
  app.add_option("--runs", runs, "How many")->check(CLI::Range(1000, 1000000));
  app.add_option("--rounds", rounds, "Of which the medians count")->check(CLI::Range(1, 99));
  app.add_option("--json", json_file, "File for the figures");
  CLI11_PARSE(app, argc, argv);

  std::string folder = (std::filesystem::temp_directory_path() / "palpate-records-bench-XXXXXX").string();
  PALPATE_CHECK(::mkdtemp(folder.data()) != nullptr);
  const std::filesystem::path file = std::filesystem::path(folder) / "records.db";
  fill(file, runs);

  std::vector<double> listed_s, bare_s;
  auto records = Records::open_to_read(file);
  PALPATE_CHECK(records.ok());
  sqlite3* database = nullptr;
  PALPATE_CHECK(sqlite3_open(file.c_str(), &database) == SQLITE_OK);
  for (int n = 0; n < rounds; ++n) {
    std::size_t rows = 0;
    listed_s.push_back(seconds_of([&] {
      PALPATE_CHECK((*records)
                        ->list({},
                               [&](const RunRecord& record) -> Result<void> {
                                 rows += record.id > 0;
                                 return {};
                               })
                        .ok());
    }));
    PALPATE_CHECK(rows == static_cast<std::size_t>(runs));
    bare_s.push_back(seconds_of([&] { PALPATE_CHECK(bare(database) > 0); }));
  }
  sqlite3_close(database);
  records->reset();
  std::filesystem::remove_all(folder);

  const auto median = [](std::vector<double> values) {
    std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                     values.end());
    return values[values.size() / 2];
  };
  const double list_s = median(listed_s), query_s = median(bare_s);
  std::printf("%d runs: list %.1f ms, the bare query %.1f ms: %.2f times (at most 5)\n", runs, 1e3 * list_s,
              1e3 * query_s, list_s / query_s);
  const int code =
      write_json("records_bench", json_file,
                 {{"runs", runs}, {"list_s", list_s}, {"bare_s", query_s}, {"factor", list_s / query_s}});
  return code != 0 ? code : list_s > 5 * query_s ? 3 : 0;
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) {
  return palpate::bench::run(argc, argv);
}
