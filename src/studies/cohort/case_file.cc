#include <cstdio>

#include "palpate/base/file.h"
#include "palpate/cache/digest.h"
#include "palpate/catalog/catalog.h"
#include "palpate/cohort/case.h"
#include "palpate/cohort/cohort_table.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

std::string hex_of(const cache::Digest& digest) {
  std::string text;
  for (const std::byte byte : digest) {
    char pair[3];
    std::snprintf(pair, sizeof pair, "%02x", static_cast<unsigned>(byte));
    text += pair;
  }
  return text;
}

}  // namespace

Result<std::vector<CohortCase>> load_cohort_table(const fs::path& file) {
  constexpr std::size_t kMaxBytes = std::size_t{1} << 26;
  const auto text = read_file(file, kMaxBytes);
  if (!text) return text.error();
  auto cases = parse_cohort_table(*text, file.string(), file.parent_path(),
                                  [](const std::string& name) { return find_entry(name).ok(); });
  if (cases)
    for (CohortCase& one : *cases) one.table = file;
  return cases;
}

Result<std::string> case_key(const CohortCase& cohort_case, const std::string& program,
                             const Progress& progress) {
  // format version of results; increment when their contents change
  cache::Key key("cohort case", 3);
  key.put(program);
  key.put(find_entry(cohort_case.target).ok() ? cohort_case.target : "");
  key.put(cohort_case.segmentation.has_value());
  key.put(cohort_case.names.has_value());
  key.put(cohort_case.volume.value_or(-1));
  key.put(cohort_case.method ? static_cast<int>(*cohort_case.method) : -1);
  key.put(cohort_case.max_force_N.value_or(-1));
  key.put(cohort_case.rate_hz.value_or(-1));
  key.put(cohort_case.seed.has_value());
  key.put(cohort_case.seed.value_or(0));
  for (const auto& [role, file] : case_files(cohort_case)) {
    if (progress.stopped()) return Progress::interrupted();
    key.put(role);
    if (file.empty()) continue;
    const auto input = InputFile::open(file);
    if (!input) return input.error();
    const auto digest = cache::digest_of(*input, 0);
    if (!digest) return Error{ErrorKind::kBadInput, "cannot be read", file.string(), ""};
    key.put(input->size());
    key.put(*digest);
  }
  const auto digest = key.digest();
  if (!digest) return Error{ErrorKind::kUnavailable, "OpenSSL cannot compute SHA-256", "", ""};
  return hex_of(*digest);
}

fs::path case_folder(const fs::path& cohort, int number) {
  char name[16];
  std::snprintf(name, sizeof name, "%04d", number);
  return cohort / "cases" / name;
}

std::optional<CaseResult> find_case(const fs::path& cohort, int number, const std::string& key) {
  constexpr std::size_t kMaxBytes = std::size_t{1} << 26;
  const auto text = read_file(case_folder(cohort, number) / "result.json", kMaxBytes);
  if (!text) return std::nullopt;
  auto result = parse_case_json(*text);
  if (!result || result->key != key) return std::nullopt;
  return result;
}

}  // namespace palpate
