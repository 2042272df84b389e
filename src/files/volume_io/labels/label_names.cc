#include "volume_io/labels/label_names.h"

#include <algorithm>

#include "palpate/base/file.h"
#include "volume_io/formats/formats.h"
#include "volume_io/labels/label_text.h"

namespace palpate {

using namespace volume_io;

namespace {

// ITK-SNAP's format has names in quotation marks
bool is_snap(std::string_view text) {
  while (!text.empty()) {
    const std::string_view line = trimmed(read_line(text));
    if (!line.empty() && line.front() != '#') return line.find('"') != std::string_view::npos;
  }
  return false;
}

Result<std::vector<NamedLabel>> parse_text_table(std::string_view text, const std::string& source) {
  return is_snap(text) ? parse_snap_labels(text, source) : parse_colour_table(text, source);
}

struct Table {
  std::string_view ending;
  Result<std::vector<NamedLabel>> (*parse)(std::string_view text, const std::string& source);
};
constexpr Table kTables[] = {{".ctbl", parse_text_table}, {".tsv", parse_label_tsv},
                             {".csv", parse_label_csv},   {".label", parse_snap_labels},
                             {".lut", parse_text_table},  {".json", parse_label_json},
                             {".txt", parse_text_table}};

// file name without the extensions of its format
std::string stem_of(const std::filesystem::path& file) {
  std::string name = file.filename().string();
  for (const std::string_view ending : {".gz", ".nii", ".seg", ".nrrd", ".nhdr", ".hdr", ".img", ".mha",
                                        ".mhd", ".seg", ".stl", ".obj", ".ply", ".vtk", ".vtp"})
    if (has_extension(name, ending)) name.erase(name.size() - ending.size());
  return name;
}

}  // namespace

Result<std::vector<NamedLabel>> read_label_names(const std::filesystem::path& file) {
  const auto table = std::find_if(std::begin(kTables), std::end(kTables),
                                  [&](const Table& each) { return has_extension(file, each.ending); });
  if (table == std::end(kTables))
    return bad_input(file.string(), "has an unsupported table format",
                     "use .ctbl, .tsv, .csv, .json, .label or .txt");
  constexpr std::size_t kMaxBytes = std::size_t{1} << 24;
  const auto text = read_file(file, kMaxBytes);
  if (!text) return text.error();
  auto names = table->parse(*text, file.string());
  if (names && names->empty())
    return bad_input(file.string(), "names no label: it has only headings, comments and empty lines",
                     "give a line for each label");
  return names;
}

std::string structure_in_name(std::string_view text) {
  return anatomy_in(text).name;
}

namespace volume_io {

std::optional<AdjacentTable> find_adjacent_table(const std::filesystem::path& file,
                                                 const std::optional<std::filesystem::path>& scan) {
  const auto folder = file.parent_path().empty() ? std::filesystem::path(".") : file.parent_path();
  std::error_code failed;
  for (const Table& table : kTables) {
    // a .txt file of that name may contain anything
    if (table.ending == ".txt") continue;
    const auto beside = folder / (stem_of(file) + std::string(table.ending));
    if (std::filesystem::is_regular_file(beside, failed)) return AdjacentTable{beside, true, {}};
  }
  std::vector<std::filesystem::path> tables;
  AdjacentTable only;
  failed.clear();
  std::filesystem::directory_iterator entries(folder, failed);
  for (; !failed && entries != std::filesystem::directory_iterator(); entries.increment(failed)) {
    const std::filesystem::path& path = entries->path();
    std::error_code ignored;
    if (has_extension(path, ".ctbl") || has_extension(path, ".tsv"))
      tables.push_back(path);
    else if (format_of(path) && !std::filesystem::equivalent(path, file, ignored) &&
             !(scan && std::filesystem::equivalent(path, *scan, ignored)))
      only.others.push_back(path);
  }
  if (failed || tables.size() != 1) return std::nullopt;
  only.file = tables.front();
  std::ranges::sort(only.others);
  return only;
}

AnatomyInName name_of_mask(const std::filesystem::path& file) {
  return anatomy_in(stem_of(file));
}

}  // namespace volume_io
}  // namespace palpate
