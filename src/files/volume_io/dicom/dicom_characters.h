#pragma once

#include <optional>
#include <string>
#include <string_view>

/// Converts text of DICOM files in the character sets of PS3.3 C.12.1.1.2, including single-byte sets,
/// GB18030, GBK and those selected by ISO 2022 escape sequences (PS3.5 6.1). The bytes are untrusted.
namespace palpate::volume_io {

/// @param text  raw bytes of the element, values separated by backslashes
/// @param set   the file's SpecificCharacterSet (0008,0005), values separated by backslashes
/// @return text in UTF-8; nullopt if the set is unknown or the text is invalid in it
std::optional<std::string> dicom_text_in_utf8(std::string_view text, std::string_view set);

}  // namespace palpate::volume_io
