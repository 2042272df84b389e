#pragma once

#include <string>
#include <string_view>

/// Extracts structure names from text of unknown origin: a file is named by its user, often after the
/// patient.
namespace palpate::volume_io {

struct AnatomyInName {
  std::string name;       ///< Anatomical words in their original spelling; empty if there are none.
  bool left_out = false;  ///< The text has further words that are not neutral as "mask" is.
};
/// Words of `text` that are known to be anatomy (those of the tissue presets, TotalSegmentator and
/// FreeSurfer), each with a following number of one or two digits: "sub-01_rib_left_4" gives "rib_left_4". A
/// word is a run of letters, split before a capital that follows a lower-case letter. Words of position and
/// size count only together with an anatomical word, and "white", "small" and other words that are also
/// family names only next to their specific companion word.
AnatomyInName anatomy_in(std::string_view text);

}  // namespace palpate::volume_io
