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

/// Shared by the readers of segmentations that consist of a file, or of a folder with one file per structure:
/// surfaces and masks.
namespace palpate::volume_io {

/// Reader process that has generated voxels of labels and waits for a request to send them.
struct LabelReader {
  std::unique_ptr<reader::ReaderProcess> process;
  VolumeFile volume;
};

/// Files of one kind, each with one structure or more, that make up a segmentation.
struct StructureFiles {
  std::vector<std::filesystem::path> files;  ///< Ordered by name.
  std::vector<std::filesystem::path> roots;  ///< Files and folders that the process may open, including their
                                             ///< contents.
  std::vector<std::string> notes;            ///< About files that were left out.
  bool is_cut_off = false;                   ///< The folder contains more files than were examined.
};
/// Finds the files of a segmentation.
/// @param named              a file of that kind, or a folder; of a folder, the files directly in it are
///                           examined, except hidden ones
/// @param is_structure_file  predicate: a regular file is of this kind
/// @param kind               name of the kind: "surface"
StructureFiles find_structure_files(
    const std::filesystem::path& named,
    const std::function<bool(const std::filesystem::path&)>& is_structure_file, std::string_view kind);

/// Name of a structure by the anatomical words of its file name, unique among `others`.
struct StructureName {
  std::string name;
  bool left_out = false;  ///< Some words of the file name were dropped.
};
StructureName name_of_structure(const std::filesystem::path& file, const std::vector<std::string>& others);
/// `name`, with a number appended if `others` contains it.
std::string unique_name(std::string name, const std::vector<std::string>& others);
/// Note for the user about structures whose file names were only partly used.
std::string note_of_left_out(const std::vector<std::string>& names);

/// Labels that are built from the files, in the reader process.
struct StructureLabels {
  std::vector<std::string> names;
  std::vector<VoxelRuns> voxels;  ///< Indexed as `names`.
  std::vector<int> layers;
  VolumeFile file;
};
/// Distributes structures, whose names and voxels are set, over layers in which they do not overlap, and
/// fills in `file`. Errors: interrupted.
/// @param should_continue  called regularly; false: the parent has gone
Result<void> assign_to_layers(StructureLabels& labels, const GridGeometry& grid,
                              const std::filesystem::path& named,
                              const std::function<bool()>& should_continue);

/// Parsed volume, and a function that sends its voxels, slice by slice, any number of times.
struct SlicedVolume {
  VolumeFile file;
  std::function<Result<void>(VoxelSink& sink)> send;
};
/// Starts a process that reads files as one volume; parameters as for open_structure_files().
Result<LabelReader> open_sliced_files(
    const StructureFiles& found, const std::filesystem::path& named, const Progress& progress,
    const std::function<Result<SlicedVolume>(const std::function<bool()>& should_continue, double& fraction)>&
        inspect,
    const char* too_large);

/// Starts a process that reads the files as structures, which may overlap.
/// @param inspect    called in that process; it must call `should_continue` regularly and set `fraction` to
///                   the completed fraction of its work, 0 ... 1
/// @param too_large  remedy if the data do not fit into memory
Result<LabelReader> open_structure_files(
    const StructureFiles& found, const std::filesystem::path& named, const Progress& progress,
    const std::function<Result<StructureLabels>(const std::function<bool()>& should_continue,
                                                double& fraction)>& inspect,
    const char* too_large);

}  // namespace palpate::volume_io
