#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/reader/reader_process.h"
#include "volume_io/voxel_runs.h"
#include "volume_io/voxel_source.h"
#include "volume_io/voxel_stream.h"

/// What readers share of segmentations that are a file, or a folder with a file for each structure: surfaces
/// and masks.
namespace palpate::volume_io {

/// A process that has made voxels of labels and waits for a word to send them.
struct LabelReader {
  std::unique_ptr<reader::ReaderProcess> process;
  VolumeFile volume;
};

struct StructureFiles {
  std::vector<std::filesystem::path> files;  ///< in the order of their names
  std::vector<std::filesystem::path> roots;  ///< that the process may open, and what stands below them
  std::vector<std::string> notes;            ///< of what was left out
  bool is_cut_off = false;                   ///< the folder holds more files than were looked at
};
/// @param named   such a file, or a folder of which those that stand in it count; hidden ones do not
/// @param is_one  whether a plain file is one of them
/// @param kind    what they are: "surface"
StructureFiles find_structure_files(const std::filesystem::path& named,
                                    const std::function<bool(const std::filesystem::path&)>& is_one,
                                    std::string_view kind);

/// What a structure is called by the words of anatomy in its file's name, and in no name yet that is given.
struct StructureName {
  std::string name;
  bool left_out = false;  ///< of the file's name something
};
StructureName name_of_structure(const std::filesystem::path& file, const std::vector<std::string>& others);
/// A name, with a number where another one has it already.
std::string told_apart(std::string name, const std::vector<std::string>& others);
/// What whoever reads them should know of such names, the structures of which something was left out.
std::string note_of_left_out(const std::vector<std::string>& names);

/// What is made of the files, in the process that reads them.
struct StructureLabels {
  std::vector<std::string> names;
  std::vector<VoxelRuns> voxels;  ///< of each
  std::vector<int> layers;
  VolumeFile file;
};
/// Puts structures, whose names and voxels are there, into layers in which they do not meet, and makes the
/// volume that says so. Errors: interrupted.
/// @param look  called now and then; false: nobody listens any more
Result<void> lay_out(StructureLabels& labels, const GridGeometry& grid, const std::filesystem::path& named,
                     const std::function<bool()>& look);

/// A volume that is understood, and how its voxels are sent, slice by slice, as often as they are wanted.
struct SlicedVolume {
  VolumeFile file;
  std::function<Result<void>(VoxelSink& sink)> send;
};
/// Starts a process that reads files as one volume; the parameters are those of open_structure_files().
Result<LabelReader> open_sliced_files(
    const StructureFiles& found, const std::filesystem::path& named, const Progress& progress,
    const std::function<Result<SlicedVolume>(const std::function<bool()>& look, double& share)>& look_at,
    const char* too_large);

/// Starts a process that reads them.
/// @param look_at    called in that process with the `look` of lay_out(), which it has called, and where it
///                   writes which share of its work is done, 0 ... 1
/// @param too_large  what to do where it does not fit into the memory
Result<LabelReader> open_structure_files(
    const StructureFiles& found, const std::filesystem::path& named, const Progress& progress,
    const std::function<Result<StructureLabels>(const std::function<bool()>& look, double& share)>& look_at,
    const char* too_large);

}  // namespace palpate::volume_io
