#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "palpate/base/result.h"

/// RAII wrappers of SQLite that return palpate's errors.
namespace palpate {

struct CloseDatabase {
  void operator()(sqlite3* database) const { sqlite3_close_v2(database); }
};
struct FinishStatement {
  void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
};

/// Error for a result code of SQLite.
Error sqlite_error(int code, const std::string& what, const std::filesystem::path& file);

/// A prepared statement. Bound texts have to outlive its steps.
class Statement {
 public:
  static Result<Statement> prepare(sqlite3* database, const char* sql, const std::filesystem::path& file);

  Statement& bind(int index, const std::string& text);
  Statement& bind(int index, std::int64_t number);
  Statement& bind(int index, std::optional<double> number);
  /// Returns whether there is a row.
  Result<bool> step();
  /// Allows execution with other values.
  void reset() { sqlite3_reset(statement_.get()); }

  std::string text(int column) const;
  std::int64_t whole(int column) const { return sqlite3_column_int64(statement_.get(), column); }
  std::optional<double> number(int column) const;

 private:
  Statement(sqlite3_stmt* statement, std::filesystem::path file)
      : statement_(statement), file_(std::move(file)) {}
  std::unique_ptr<sqlite3_stmt, FinishStatement> statement_;
  std::filesystem::path file_;
};

/// Executes one or more statements without parameters and results.
Result<void> execute(sqlite3* database, const char* sql, const std::filesystem::path& file);

}  // namespace palpate
