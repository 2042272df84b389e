#include <algorithm>
#include <cstdio>

#include "palpate/base/file.h"
#include "palpate/cache/digest.h"
#include "palpate/catalog/catalog.h"
#include "palpate/cohort/cohort.h"
#include "palpate/scene/scene.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

/// Every file below a folder, or the file itself.
void add_files(const fs::path& what, std::vector<fs::path>& files) {
  std::error_code failed;
  if (!fs::is_directory(what, failed)) {
    files.push_back(what);
    return;
  }
  std::vector<fs::path> found;
  using Walk = fs::recursive_directory_iterator;
  Walk entry(what, fs::directory_options::skip_permission_denied, failed);
  for (; !failed && entry != Walk(); entry.increment(failed)) {
    std::error_code ignored;
    if (entry->is_regular_file(ignored)) found.push_back(entry->path());
  }
  std::ranges::sort(found);
  files.insert(files.end(), found.begin(), found.end());
}

/// Tables of names that are read with labels unasked, and the data file of a header.
void add_beside(const fs::path& labels, std::vector<fs::path>& files) {
  const std::string name = labels.filename().string();
  const std::string stem = name.substr(0, name.find('.'));
  std::vector<fs::path> found;
  std::error_code failed;
  const fs::path folder = labels.parent_path().empty() ? fs::path(".") : labels.parent_path();
  fs::directory_iterator entry(folder, failed);
  for (; !failed && entry != fs::directory_iterator(); entry.increment(failed)) {
    const std::string other = entry->path().filename().string();
    std::error_code ignored;
    if (other != name && other.starts_with(stem + ".") && entry->is_regular_file(ignored))
      found.push_back(entry->path());
  }
  std::ranges::sort(found);
  files.insert(files.end(), found.begin(), found.end());
}

std::vector<fs::path> files_of(const CohortCase& one) {
  std::vector<fs::path> files;
  const auto add = [&](const std::optional<fs::path>& file) {
    if (!file) return;
    add_files(*file, files);
    std::error_code failed;
    if (!fs::is_directory(*file, failed)) add_beside(*file, files);
  };
  if (find_entry(one.target)) {
    // a phantom is its name
    if (const auto data = locate(one.target)) {
      add(data->labels);
      add(data->scan);
      add(data->names);
    }
  } else {
    add(fs::path(one.target));
    // what is wrong with a scene is told where it is used
    if (const auto scene = load_scene(one.target))
      for (const auto& file : {scene->scan, scene->labels, scene->names})
        if (file) add(scene->resolve(*file));
  }
  add(one.segmentation);
  if (one.script) files.push_back(*one.script);
  return files;
}

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
  constexpr std::size_t kMostBytes = std::size_t{1} << 26;
  const auto text = read_file(file, kMostBytes);
  if (!text) return text.error();
  return parse_cohort_table(*text, file.string(), file.parent_path(),
                            [](const std::string& name) { return find_entry(name).ok(); });
}

Result<std::string> case_key(const CohortCase& one, const std::string& program, const Progress& progress) {
  // version 1: raised by whoever changes what a result says
  cache::Key key("cohort case", 1);
  key.put(program);
  key.put(find_entry(one.target).ok() ? one.target : "");
  key.put(one.segmentation.has_value());
  key.put(one.volume.value_or(-1));
  key.put(one.method ? static_cast<int>(*one.method) : -1);
  key.put(one.max_force_N.value_or(-1));
  key.put(one.rate_hz.value_or(-1));
  key.put(one.seed.has_value());
  key.put(one.seed.value_or(0));
  for (const fs::path& file : files_of(one)) {
    if (progress.stopped()) return Progress::interrupted();
    const auto input = InputFile::open(file);
    if (!input) return input.error();
    const auto digest = cache::digest_of(*input, 0);
    if (!digest) return Error{ErrorKind::kBadInput, "cannot be read", file.string(), ""};
    key.put(input->size());
    key.put(*digest);
  }
  const auto digest = key.digest();
  if (!digest) return Error{ErrorKind::kUnavailable, "OpenSSL computes no SHA-256", "", ""};
  return hex_of(*digest);
}

std::string without_names(std::string text, const CohortCase& one) {
  // the longest first: a path holds its file's name
  std::vector<std::string> names;
  const auto add = [&](const fs::path& file) {
    names.push_back(file.string());
    std::error_code failed;
    const fs::path whole = fs::absolute(file, failed);
    if (!failed) names.push_back(whole.lexically_normal().string());
    for (const fs::path& part : whole) {
      names.push_back(part.string());
      names.push_back(part.stem().string());
      names.push_back(part.stem().stem().string());
    }
    if (!fs::is_directory(file, failed)) return;
    // and what an error within a study might name
    using Walk = fs::recursive_directory_iterator;
    Walk entry(file, fs::directory_options::skip_permission_denied, failed);
    for (; !failed && entry != Walk(); entry.increment(failed))
      names.push_back(entry->path().filename().string());
  };
  if (!find_entry(one.target).ok()) add(one.target);
  if (one.segmentation) add(*one.segmentation);
  if (one.script) add(*one.script);
  std::ranges::sort(
      names, [](const auto& a, const auto& b) { return a.size() != b.size() ? a.size() > b.size() : a < b; });
  names.erase(std::unique(names.begin(), names.end()), names.end());
  const auto is_letter = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || static_cast<unsigned char>(c) >= 0x80;
  };
  for (const std::string& name : names) {
    // what is shorter names nobody, and would tear words apart
    if (name.size() < 3) continue;
    for (std::size_t at = text.find(name); at != text.npos; at = text.find(name, at)) {
      const bool within =
          (at > 0 && is_letter(text[at - 1]) && is_letter(name.front())) ||
          (at + name.size() < text.size() && is_letter(text[at + name.size()]) && is_letter(name.back()));
      if (within) {
        at += name.size();
        continue;
      }
      text.replace(at, name.size(), "\xe2\x80\xa6");
      at += 3;
    }
  }
  return text;
}

fs::path case_folder(const fs::path& cohort, int number) {
  char name[16];
  std::snprintf(name, sizeof name, "%04d", number);
  return cohort / "cases" / name;
}

std::optional<CaseResult> find_case(const fs::path& cohort, int number, const std::string& key) {
  constexpr std::size_t kMostBytes = std::size_t{1} << 26;
  const auto text = read_file(case_folder(cohort, number) / "result.json", kMostBytes);
  if (!text) return std::nullopt;
  auto result = parse_case_json(*text);
  if (!result || result->key != key) return std::nullopt;
  return result;
}

}  // namespace palpate
