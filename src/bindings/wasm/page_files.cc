#include "wasm/page_files.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <vector>

#include "palpate/volume_io/volume_io.h"
#include "volume_io/formats/formats.h"
#include "volume_io/labels/label_text.h"
#include "volume_io/volume_reader.h"

namespace palpate::wasm {
namespace {

using volume_io::has_extension;

constexpr std::array<std::string_view, 7> kTables{".ctbl", ".tsv", ".csv", ".label", ".lut", ".json", ".txt"};
constexpr const char* kReads =
    "give a label map, and its scan if you like, as NRRD (.nrrd, .seg.nrrd), NIfTI (.nii, "
    ".nii.gz) or MetaImage (.mha, .mhd with its data file)";

bool is_table(const std::filesystem::path& file) {
  return std::ranges::any_of(kTables, [&](std::string_view ending) { return has_extension(file, ending); });
}

// an .img whose .hdr is given, too, is read with that
bool is_data_of_header(const std::filesystem::path& file, const std::vector<std::filesystem::path>& all) {
  if (!has_extension(file, ".img") && !has_extension(file, ".img.gz")) return false;
  const auto stem_of = [](std::filesystem::path path) {
    if (has_extension(path, ".gz")) path.replace_extension();
    return path.replace_extension();
  };
  return std::ranges::any_of(all, [&](const std::filesystem::path& other) {
    return (has_extension(other, ".hdr") || has_extension(other, ".hdr.gz")) &&
           stem_of(other) == stem_of(file);
  });
}

Error no_volume(const std::vector<std::filesystem::path>& files) {
  if (files.empty()) return {ErrorKind::kUsage, "no file was given", "", kReads};
  for (const std::filesystem::path& file : files) {
    const auto kind = volume_io::file_kind_of(file, volume_io::unpacked_front);
    if (kind && kind->readable_format.empty())
      return volume_io::bad_input(file.string(), "is " + kind->what, kind->remedy);
    if (kind)
      return volume_io::bad_input(file.string(),
                                  "is " + kind->what + ", which a page does not read by this name", kReads);
  }
  return volume_io::bad_input(files.front().string(), "is no volume", kReads);
}

}  // namespace

Result<SceneSource> source_of_files(std::string_view names) {
  std::vector<std::filesystem::path> files, volumes, tables, scenes;
  while (!names.empty()) {
    const std::string_view name = volume_io::read_line(names);
    if (!name.empty()) files.emplace_back(std::string(name));
  }
  for (const std::filesystem::path& file : files) {
    if (has_extension(file, ".toml")) scenes.push_back(file);
    if (is_table(file)) tables.push_back(file);
    if (volume_io::format_of(file) && !is_data_of_header(file, files)) volumes.push_back(file);
  }
  SceneSource source;
  source.law = TissueLaw::kLayers;
  source.touch_unknown = true;
  if (scenes.size() == 1) {
    source.target = scenes.front().string();
    return source;
  }
  if (volumes.empty()) return no_volume(files);
  constexpr std::size_t kMost = 2;
  if (volumes.size() > kMost)
    return volume_io::bad_input(volumes[kMost].string(),
                                "is the third of " + std::to_string(volumes.size()) +
                                    " volumes, but a scene has a label map and a scan",
                                "give these two alone");
  if (tables.size() > 1)
    return volume_io::bad_input(tables[1].string(), "is a second table of names", "give one table");
  source.target = volumes.front().string();
  if (volumes.size() == kMost) source.segmentation = volumes.back();
  if (!tables.empty()) source.names = tables.front();
  return source;
}

}  // namespace palpate::wasm
