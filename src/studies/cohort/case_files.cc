#include <algorithm>
#include <array>
#include <set>

#include "palpate/base/file.h"
#include "palpate/base/printable.h"
#include "palpate/catalog/catalog.h"
#include "palpate/cohort/case.h"
#include "palpate/cohort/cohort_table.h"
#include "palpate/scene/scene.h"
#include "palpate/volume_io/label_tables.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

std::string in_small_letters(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return text;
}

fs::path folder_around(const fs::path& file) {
  const fs::path parent = file.parent_path();
  return parent.empty() ? fs::path(".") : parent;
}

/// Sorted names in a folder; a folder with more entries than the limit does not hold a study.
std::vector<fs::path> entries_of(const fs::path& folder) {
  constexpr std::size_t kMaxEntries = 100'000;
  std::vector<fs::path> found;
  std::error_code failed;
  fs::directory_iterator entry(folder, failed);
  for (; !failed && entry != fs::directory_iterator() && found.size() < kMaxEntries; entry.increment(failed))
    found.push_back(entry->path());
  std::ranges::sort(found);
  return found;
}

/// Data file named by a header of NRRD or MetaImage, as written, whether or not it exists.
std::optional<std::string> data_named_in(const fs::path& header) {
  const std::string ending = in_small_letters(header.extension().string());
  if (ending != ".nhdr" && ending != ".nrrd" && ending != ".mhd" && ending != ".mha") return std::nullopt;
  const auto file = InputFile::open(header);
  if (!file) return std::nullopt;
  // the readers accept longer headers, but those consist mostly of comments
  std::string front(std::size_t{1} << 18, '\0');
  const auto received = file->read_at(0, std::as_writable_bytes(std::span(front)));
  if (!received) return std::nullopt;
  front.resize(*received);
  std::string_view remaining = front;
  while (!remaining.empty()) {
    const auto end = remaining.find('\n');
    std::string_view line = remaining.substr(0, end);
    remaining = end == remaining.npos ? std::string_view() : remaining.substr(end + 1);
    while (!line.empty() && (line.back() == '\r' || line.back() == ' ')) line.remove_suffix(1);
    // in NRRD an empty line ends the header
    if (line.empty() && ending.starts_with(".n")) return std::nullopt;
    const auto mark = line.find_first_of(":=");
    if (mark == line.npos) continue;
    std::string field;
    for (const char c : in_small_letters(std::string(line.substr(0, mark))))
      if (c != ' ') field += c;
    if (field != "datafile" && field != "elementdatafile") continue;
    const auto begin = line.find_first_not_of(" \t", mark + 1);
    const std::string name(begin == line.npos ? std::string_view() : line.substr(begin));
    if (name.empty() || name.find('\0') != name.npos || in_small_letters(name) == "local")
      return std::nullopt;
    return name;
  }
  return std::nullopt;
}

/// Files of a case, and the names by which a text may refer to them.
struct Files {
  std::vector<CaseFile> files;
  std::vector<fs::path> named;  ///< Files named by the case, its scene and headers, whether or not they exist
};

void add_with_data(const std::string& role, const fs::path& file, Files& all) {
  all.files.push_back({role, file});
  const auto data = data_named_in(file);
  if (!data) return;
  const fs::path at = folder_around(file) / *data;
  all.named.push_back(at);
  std::error_code failed;
  if (fs::is_regular_file(at, failed)) all.files.push_back({role + " data", at});
}

/// Adds colour tables that are read with the labels automatically, and further parts of a volume in several
/// files.
void add_beside(const std::string& role, const fs::path& labels, const fs::path& table, Files& all) {
  const std::string name = labels.filename().string();
  const std::string stem = name.substr(0, name.find('.'));
  std::vector<fs::path> tables;
  for (const fs::path& entry : entries_of(folder_around(labels))) {
    std::error_code failed;
    const std::string other = entry.filename().string();
    if (other == name || !fs::is_regular_file(entry, failed)) continue;
    const std::string ending = in_small_letters(entry.extension().string());
    if (other.starts_with(stem + "."))
      all.files.push_back({role + " beside " + other, entry});
    else if (ending == ".ctbl" || ending == ".tsv")
      tables.push_back(entry);
  }
  for (const fs::path& entry : tables) {
    // the cohort's own table is not a colour table, whatever rows are added to it
    const bool own = !table.empty() && same_file(entry, table);
    all.files.push_back({role + (own ? " next to the cohort's table" : " table " + entry.filename().string()),
                         own ? fs::path() : entry});
  }
}

/// Adds names found in a scene that cannot be parsed, because its error may quote them.
void add_named_in_broken(const fs::path& scene, Files& all) {
  constexpr std::size_t kMaxBytes = std::size_t{1} << 20;
  if (in_small_letters(scene.extension().string()) != ".toml") return;
  const auto text = read_file(scene, kMaxBytes);
  if (!text) return;
  for (std::size_t at = 0; at < text->size();) {
    const std::size_t end = std::min(text->find('\n', at), text->size());
    const std::string_view line = std::string_view(*text).substr(at, end - at);
    at = end + 1;
    const auto equal = line.find('='), begin = line.find_first_of("\"'", equal),
               word = line.find_first_not_of(" \t");
    if (equal == line.npos || begin == line.npos) continue;
    const std::string_view field = line.substr(word);
    if (!field.starts_with("scan") && !field.starts_with("labels") && !field.starts_with("names")) continue;
    if (line.find_first_not_of(" \t", equal + 1) != begin) continue;
    const auto close = line.find(line[begin], begin + 1);
    const std::string name(line.substr(begin + 1, close == line.npos ? close : close - begin - 1));
    if (name.empty()) continue;
    const fs::path file = folder_around(scene) / name;
    all.named.push_back(file);
    std::error_code failed;
    if (fs::is_regular_file(file, failed)) add_with_data("scene's", file, all);
  }
}

Files files_of(const CohortCase& one) {
  Files all;
  const auto add = [&](const std::string& role, const std::optional<fs::path>& file) {
    if (!file) return;
    all.named.push_back(*file);
    std::error_code failed;
    if (fs::is_directory(*file, failed)) {
      std::vector<fs::path> found;
      using Walk = fs::recursive_directory_iterator;
      Walk entry(*file, fs::directory_options::skip_permission_denied, failed);
      for (; !failed && entry != Walk(); entry.increment(failed)) {
        std::error_code ignored;
        if (entry->is_regular_file(ignored)) found.push_back(entry->path());
      }
      std::ranges::sort(found);
      for (const fs::path& each : found)
        add_with_data(role + " " + each.lexically_relative(*file).string(), each, all);
    } else {
      add_with_data(role + " " + file->filename().string(), *file, all);
    }
    add_beside(role, *file, one.table, all);
  };
  if (find_entry(one.target)) {
    // a phantom is fully described by its name
    if (const auto data = locate(one.target)) {
      add("set labels", data->labels);
      add("set scan", data->scan);
      add("set names", data->names);
    }
  } else {
    add("study", fs::path(one.target));
    // errors of a scene are reported where it is used
    if (const auto scene = load_scene(one.target)) {
      const auto resolved = [&](const std::optional<fs::path>& file) -> std::optional<fs::path> {
        if (!file) return std::nullopt;
        return scene->resolve(*file);
      };
      add("scene scan", resolved(scene->scan));
      add("scene labels", resolved(scene->labels));
      add("scene names", resolved(scene->names));
    } else {
      add_named_in_broken(one.target, all);
    }
  }
  add("segmentation", one.segmentation);
  for (const auto& [role, file] : {std::pair("names", one.names), std::pair("script", one.script)}) {
    if (!file) continue;
    all.named.push_back(*file);
    all.files.push_back({role, *file});
  }
  return all;
}

// ---- removal of names -----------------------------------------------------------------------------------

constexpr std::string_view kGap = "\xe2\x80\xa6";

// common names of folders and files; removing them would garble sentences
constexpr std::array kCommon{
    "bin",    "case",    "cases",   "cohort", "data",  "dev",     "dicom",        "export",
    "file",   "files",   "folder",  "home",   "image", "images",  "input",        "knee",
    "label",  "labels",  "mask",    "masks",  "media", "mnt",     "model",        "names",
    "nifti",  "opt",     "out",     "output", "part",  "patient", "patients",     "press",
    "result", "results", "root",    "scan",   "scans", "scene",   "scenes",       "script",
    "series", "set",     "share",   "shared", "srv",   "step",    "studies",      "study",
    "table",  "test",    "tissue",  "tmp",    "touch", "user",    "users",        "usr",
    "var",    "volume",  "volumes", "work",   "mesh",  "surface", "segmentation", "segmentations",
    "slice",  "slices",  "voxel",   "voxels", "force", "header",  "structure",    "surfaces"};

bool says_nothing(const std::string& name) {
  // shorter names do not identify anyone, and removing them would garble words
  if (name.size() < 3) return true;
  return std::ranges::find(kCommon, name) != kCommon.end() || structure_in_name(name) == name;
}

std::vector<std::string> names_of(const CohortCase& one, const fs::path& cohort) {
  std::set<std::string> names;
  const auto put = [&](const std::string& name, bool whole) {
    if (name.size() < 3 || (!whole && says_nothing(name))) return;
    names.insert(name);
    names.insert(printable(name));
    names.insert(printable_name(name));
  };
  // with and without extensions
  const auto put_name = [&](const fs::path& name) {
    put(name.string(), false);
    put(name.stem().string(), false);
    put(name.stem().stem().string(), false);
    const std::string all = name.string();
    put(all.substr(0, all.find('.')), false);
  };
  const auto put_path = [&](const fs::path& file) {
    if (file.empty()) return;
    std::error_code failed;
    put(file.string(), file.has_parent_path());
    put(file.lexically_normal().string(), file.has_parent_path());
    const fs::path whole = fs::absolute(file, failed);
    if (failed) return;
    put(whole.string(), true);
    put(whole.lexically_normal().string(), true);
    const fs::path real = fs::weakly_canonical(whole, failed);
    if (!failed) put(real.string(), true);
    for (const fs::path& path : {whole, real})
      for (const fs::path& part : path) put_name(part);
  };
  const Files all = files_of(one);
  std::set<fs::path> folders;
  for (const CaseFile& each : all.files) {
    put_path(each.file);
    if (!each.file.empty()) folders.insert(folder_around(each.file));
  }
  std::error_code failed;
  for (const fs::path& each : all.named) {
    // a data set of the catalogue is not a file
    if (each == fs::path(one.target) && find_entry(one.target).ok()) continue;
    put_path(each);
    folders.insert(fs::is_directory(each, failed) ? each : folder_around(each));
  }
  put_path(one.table);
  put_path(cohort);
  for (const fs::path& folder : folders) {
    put_path(folder);
    for (const fs::path& entry : entries_of(folder)) put_name(entry.filename());
  }
  names.erase("");
  return {names.begin(), names.end()};
}

bool is_name_letter(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || static_cast<unsigned char>(c) >= 0x80;
}

/// Whether a word is a path, or a file name by its extension.
bool is_path(std::string_view word) {
  constexpr std::string_view kAround = ",;:.()[]{}\"'`<>";
  while (!word.empty() && kAround.find(word.back()) != kAround.npos) word.remove_suffix(1);
  while (!word.empty() && word.front() != '.' && kAround.find(word.front()) != kAround.npos)
    word.remove_prefix(1);
  constexpr std::array kUnits{"N/mm", "mm/s", "N/m", "m/s", "N/s", "Ns/m", "N*s/m", "1/s", "kg/m3", "and/or"};
  if (word.find('/') != word.npos) return std::ranges::find(kUnits, word) == kUnits.end();
  constexpr std::array kEndings{".nii", ".nrrd", ".nhdr", ".mha",   ".mhd",  ".raw",  ".zraw",
                                ".hdr", ".img",  ".gz",   ".dcm",   ".ima",  ".toml", ".tsv",
                                ".csv", ".ctbl", ".lut",  ".txt",   ".json", ".stl",  ".obj",
                                ".ply", ".vtk",  ".vtp",  ".h5",    ".xml",  ".bin",  ".zip",
                                ".tif", ".tiff", ".png",  ".label", ".html", ".part", ".lock"};
  const std::string lower = in_small_letters(std::string(word));
  return std::ranges::any_of(kEndings, [&](std::string_view ending) {
    return lower.size() > ending.size() && lower.ends_with(ending);
  });
}

}  // namespace

std::vector<CaseFile> case_files(const CohortCase& cohort_case) {
  return files_of(cohort_case).files;
}

std::string without_names(std::string text, const CohortCase& cohort_case, const fs::path& cohort) {
  // longest first, because a path contains the name of its file
  auto names = names_of(cohort_case, cohort);
  std::ranges::sort(
      names, [](const auto& a, const auto& b) { return a.size() != b.size() ? a.size() > b.size() : a < b; });
  for (const std::string& name : names)
    for (std::size_t at = text.find(name); at != text.npos; at = text.find(name, at)) {
      const std::size_t end = at + name.size();
      const bool is_inside = (at > 0 && is_name_letter(text[at - 1]) && is_name_letter(name.front()) &&
                              !std::string_view(text).substr(0, at).ends_with(kGap)) ||
                             (end < text.size() && is_name_letter(text[end]) && is_name_letter(name.back()) &&
                              !std::string_view(text).substr(end).starts_with(kGap));
      if (is_inside) {
        at = end;
        continue;
      }
      text.replace(at, name.size(), kGap);
      at += kGap.size();
    }
  // remaining paths and file names belong to unknown files; a path may contain spaces, so the text between
  // two of its pieces is removed as well
  std::size_t first = text.npos, last = 0;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t word = text.find_first_not_of(" \t\n", begin);
    if (word == text.npos) break;
    const std::size_t end = std::min(text.find_first_of(" \t\n", word), text.size());
    if (is_path(std::string_view(text).substr(word, end - word))) {
      first = std::min(first, word);
      last = end;
    }
    begin = end;
  }
  if (first != text.npos) text.replace(first, last - first, kGap);
  return text;
}

}  // namespace palpate
