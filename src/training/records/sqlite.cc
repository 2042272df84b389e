#include "records/sqlite.h"

#include <cmath>

#include "palpate/base/printable.h"

namespace palpate {

Error sqlite_error(int code, const std::string& what, const std::filesystem::path& file) {
  const std::string why = printable_name(what);
  switch (code & 0xff) {
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return {ErrorKind::kUnavailable, "another program has the records open", file.string(),
              "try again when it has ended"};
    case SQLITE_NOTADB:
    case SQLITE_CORRUPT:
    case SQLITE_ERROR:
    case SQLITE_MISMATCH:
    case SQLITE_TOOBIG:
      return {ErrorKind::kBadInput, "these are not complete records of palpate (" + why + ")", file.string(),
              "give another file, or restore its last copy"};
    case SQLITE_CANTOPEN:
      return {ErrorKind::kOutput, "the records cannot be opened (" + why + ")", file.string(),
              "check that its folder exists and is writable"};
    default:
      return {ErrorKind::kOutput, "the records cannot be written (" + why + ")", file.string(),
              "check the disk and the permissions of the file and its folder"};
  }
}

Result<Statement> Statement::prepare(sqlite3* database, const char* sql, const std::filesystem::path& file) {
  sqlite3_stmt* statement = nullptr;
  const int code = sqlite3_prepare_v2(database, sql, -1, &statement, nullptr);
  if (code != SQLITE_OK) return sqlite_error(code, sqlite3_errmsg(database), file);
  return Statement(statement, file);
}

Statement& Statement::bind(int index, const std::string& text) {
  PALPATE_CHECK(sqlite3_bind_text64(statement_.get(), index, text.data(), text.size(), SQLITE_STATIC,
                                    SQLITE_UTF8) == SQLITE_OK);
  return *this;
}

Statement& Statement::bind(int index, std::int64_t number) {
  PALPATE_CHECK(sqlite3_bind_int64(statement_.get(), index, number) == SQLITE_OK);
  return *this;
}

Statement& Statement::bind(int index, std::optional<double> number) {
  const int code = number ? sqlite3_bind_double(statement_.get(), index, *number)
                          : sqlite3_bind_null(statement_.get(), index);
  PALPATE_CHECK(code == SQLITE_OK);
  return *this;
}

Result<bool> Statement::step() {
  const int code = sqlite3_step(statement_.get());
  if (code == SQLITE_ROW) return true;
  if (code == SQLITE_DONE) return false;
  return sqlite_error(code, sqlite3_errmsg(sqlite3_db_handle(statement_.get())), file_);
}

std::string Statement::text(int column) const {
  const auto* bytes = reinterpret_cast<const char*>(sqlite3_column_text(statement_.get(), column));
  const int size = sqlite3_column_bytes(statement_.get(), column);
  return bytes != nullptr && size > 0 ? std::string(bytes, static_cast<std::size_t>(size)) : std::string();
}

std::optional<double> Statement::number(int column) const {
  if (sqlite3_column_type(statement_.get(), column) == SQLITE_NULL) return std::nullopt;
  const double value = sqlite3_column_double(statement_.get(), column);
  return std::isfinite(value) ? std::optional(value) : std::nullopt;
}

Result<void> execute(sqlite3* database, const char* sql, const std::filesystem::path& file) {
  const int code = sqlite3_exec(database, sql, nullptr, nullptr, nullptr);
  if (code != SQLITE_OK) return sqlite_error(code, sqlite3_errmsg(database), file);
  return {};
}

}  // namespace palpate
