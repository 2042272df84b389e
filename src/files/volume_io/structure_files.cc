#include "volume_io/structure_files.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <new>
#include <set>
#include <variant>

#include "palpate/base/file.h"
#include "palpate/base/reading.h"
#include "volume_io/labels/label_names.h"
#include "volume_io/labels/layered_labels.h"
#include "volume_io/volume_message.h"
#include "volume_io/volume_reader.h"

namespace palpate::volume_io {

namespace fs = std::filesystem;

namespace {

// limits calls of `sign` to ten per second
std::function<bool()> rate_limited(const std::function<bool()>& sign) {
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kBetween(100);
  return [sign, next = Clock::now(), is_alive = true]() mutable {
    if (const auto now = Clock::now(); is_alive && now >= next) {
      next = now + kBetween;
      is_alive = sign();
    }
    return is_alive;
  };
}

Result<void> send_structures(const StructureLabels& labels, VoxelSink& sink) {
  const auto read_slice = [&](int layer, std::size_t k, const auto& visit) -> Result<void> {
    for (std::size_t n = 0; n < labels.voxels.size(); ++n)
      if (labels.layers[n] == layer)
        labels.voxels[n].read_slice(static_cast<int>(k),
                                    [&](std::size_t v) { visit(v, static_cast<int>(n + 1)); });
    return {};
  };
  return send_layers(labels.file.header, read_slice, sink);
}

}  // namespace

StructureFiles find_structure_files(const fs::path& named,
                                    const std::function<bool(const fs::path&)>& is_structure_file,
                                    std::string_view kind) {
  StructureFiles found;
  found.roots.push_back(named);
  std::error_code failed;
  if (!fs::is_directory(named, failed)) {
    if (is_structure_file(named)) found.files.push_back(named);
    return found;
  }
  // each root is a file descriptor in the reader process
  constexpr std::size_t kMaxFiles = 4096, kMaxRoots = 256;
  std::size_t inspected = 0, others = 0, outside_links = 0, scattered = 0;
  std::set<fs::path> outside;
  fs::directory_iterator entry(named, failed);
  for (; !failed && entry != fs::directory_iterator() && inspected < kMaxFiles; entry.increment(failed)) {
    std::error_code ignored;
    // hidden files, such as macOS's "._liver.nii.gz"
    if (!entry->is_regular_file(ignored) || entry->path().filename().string().starts_with('.')) continue;
    ++inspected;
    if (!is_structure_file(entry->path())) {
      ++others;
      continue;
    }
    if (entry->is_symlink(ignored)) {
      if (!check_stays_in(named, entry->path())) {
        ++outside_links;
        continue;
      }
      const fs::path root = fs::canonical(entry->path(), ignored).parent_path();
      if (outside.size() >= kMaxRoots && !outside.contains(root)) {
        ++scattered;
        continue;
      }
      outside.insert(root);
    }
    found.files.push_back(entry->path());
  }
  found.roots.insert(found.roots.end(), outside.begin(), outside.end());
  found.is_cut_off = !failed && entry != fs::directory_iterator();
  if (found.is_cut_off)
    found.notes.push_back("holds more than " + std::to_string(kMaxFiles) + " files; the others were ignored");
  std::ranges::sort(found.files);
  if (outside_links > 0)
    found.notes.push_back(std::to_string(outside_links) +
                          (outside_links == 1 ? " link leads" : " links lead") +
                          " out of the folder and was not followed (--follow-links allows it)");
  if (scattered > 0)
    found.notes.push_back(std::to_string(scattered) + (scattered == 1 ? " link was" : " links were") +
                          " not followed, because they lead to more than " + std::to_string(kMaxRoots) +
                          " folders");
  if (others > 0)
    found.notes.push_back(std::to_string(others) +
                          (others == 1 ? " other file in it is" : " other files in it are") + " no " +
                          std::string(kind) + ", and ignored");
  return found;
}

std::string unique_name(std::string name, const std::vector<std::string>& others) {
  if (std::ranges::find(others, name) != others.end()) name += " (" + std::to_string(others.size() + 1) + ")";
  return name;
}

StructureName name_of_structure(const fs::path& file, const std::vector<std::string>& others) {
  const AnatomyInName words = name_of_mask(file);
  if (words.name.empty())
    return {unique_name("structure " + std::to_string(others.size() + 1), others), words.left_out};
  return {unique_name(words.name, others), words.left_out};
}

std::string note_of_left_out(const std::vector<std::string>& names) {
  return "has words in the names of its files or objects that are not known anatomical words and might "
         "identify a patient; a table can set any name for their structures, numbered in their order "
         "(--names TABLE). They are called: " +
         names_in_words(names);
}

Result<void> assign_to_layers(StructureLabels& labels, const GridGeometry& grid, const fs::path& named,
                              const std::function<bool()>& should_continue) {
  const auto read_slice = [&](std::size_t k, const auto& visit) -> Result<void> {
    for (std::size_t n = 0; n < labels.voxels.size(); ++n)
      labels.voxels[n].read_slice(static_cast<int>(k), [&](std::size_t v) { visit(v, static_cast<int>(n)); });
    return {};
  };
  const auto overlaps = find_overlapping_pairs(grid, read_slice, should_continue);
  if (!overlaps) return overlaps.error();
  labels.file = labels_in_slices(grid, named);
  labels.layers = assign_layers(labels.voxels.size(), *overlaps, labels.file);
  for (std::size_t n = 0; n < labels.names.size(); ++n)
    put_segment(labels.file, n, labels.names[n], static_cast<int>(n + 1), labels.layers[n], "");
  return {};
}

Result<LabelReader> open_structure_files(
    const StructureFiles& found, const fs::path& named, const Progress& progress,
    const std::function<Result<StructureLabels>(const std::function<bool()>& should_continue,
                                                double& fraction)>& inspect,
    const char* too_large) {
  return open_sliced_files(
      found, named, progress,
      [&](const std::function<bool()>& should_continue, double& fraction) -> Result<SlicedVolume> {
        auto labels = inspect(should_continue, fraction);
        if (!labels) return labels.error();
        const auto stored = std::make_shared<const StructureLabels>(*std::move(labels));
        return SlicedVolume{stored->file,
                            [stored](VoxelSink& sink) { return send_structures(*stored, sink); }};
      },
      too_large);
}

Result<LabelReader> open_sliced_files(
    const StructureFiles& found, const fs::path& named, const Progress& progress,
    const std::function<Result<SlicedVolume>(const std::function<bool()>& should_continue, double& fraction)>&
        inspect,
    const char* too_large) {
  std::vector<int> descriptors;
  for (const fs::path& root : found.roots)
    if (const int descriptor = ::open(root.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK); descriptor >= 0)
      descriptors.push_back(descriptor);
  // files that a refusal may name
  std::vector<fs::path> names{named};
  names.insert(names.end(), found.files.begin(), found.files.end());
  auto process = start_reader(descriptors, kSlots * kSlotBytes, progress, [&](reader::ParentEnd& parent) {
    double fraction = 0;
    const auto report = [&] {
      const auto word = static_cast<std::uint32_t>(std::lround(1000 * fraction));
      return parent.write(std::as_bytes(std::span(&word, 1)));
    };
    const auto volume = [&]() -> Result<SlicedVolume> {
      try {
        return inspect(rate_limited(report), fraction);
      } catch (const std::bad_alloc&) {
        return bad_input(named.string(), "does not fit into the memory for reading", too_large);
      }
    }();
    return serve_labels(parent, named, volume, [&](VoxelSink& sink) { return volume->send(sink); });
  });
  for (const int descriptor : descriptors) ::close(descriptor);
  if (!process)
    return Error{process.error().kind, process.error().what, named.string(), process.error().remedy};
  while (true) {
    std::uint32_t word = 0;
    if (auto received = (*process)->read(std::as_writable_bytes(std::span(&word, 1))); !received)
      return about(received.error(), names);
    if (word != kEnd) {
      progress.report("examining each file", std::min(1.0, word / 1000.0));
      continue;
    }
    if (auto understood = receive_end(**process, names); !understood) return understood.error();
    break;
  }
  const Files one{&named, 1};
  auto answer = receive_answer(**process, one);
  if (!answer) return answer.error();
  auto* volume = std::get_if<VolumeFile>(&*answer);
  if (!volume || volume->voxels.encoding != Encoding::kSlices) return impossible_volume(one);
  return LabelReader{*std::move(process), std::move(*volume)};
}

}  // namespace palpate::volume_io
