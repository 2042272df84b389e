#pragma once

#include <string>
#include <string_view>

/// What of a text of unknown origin may be taken as a structure's name: a file is called by whoever saved
/// it, and often after the patient.
namespace palpate::volume_io {

struct AnatomyInName {
  std::string name;       ///< the words of anatomy, as they are spelt; empty: there are none
  bool left_out = false;  ///< there are other words, besides such as "mask" that say nothing of anybody
};
/// The words of `text` that are known to be anatomy (tissue presets', TotalSegmentator's, FreeSurfer's), each
/// with a number of one or two digits that follows it: "sub-01_rib_left_4" gives "rib_left_4".
/// Words are runs of letters, split where a capital follows a small letter. Words of place and size count
/// beside a word of anatomy only, and "white", "small" and others that people are called beside their own.
AnatomyInName anatomy_in(std::string_view text);

}  // namespace palpate::volume_io
