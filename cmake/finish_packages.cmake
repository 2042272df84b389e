# Run by CPack before it packs: adds what Debian's policy asks of each package, its licence and its changelog, and compresses
# man pages.
if(NOT CPACK_GENERATOR STREQUAL "DEB")
  return()
endif()
cmake_path(GET CMAKE_CURRENT_LIST_DIR PARENT_PATH source)
execute_process(COMMAND git -C ${source} log -1 --format=%cD OUTPUT_VARIABLE date OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
if(NOT date)
  string(TIMESTAMP date "%a, %d %b %Y %H:%M:%S +0000" UTC)
endif()

set(copyright "Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
Upstream-Name: palpate

Files: *
Copyright: the authors of palpate
License: Apache-2.0
 On Debian systems the text of the licence is in /usr/share/common-licenses/Apache-2.0.
")
# compiled into the program: the plots of the report, and the state of the page
foreach(part uplot preact-signals)
  file(READ ${source}/third_party/${part}/LICENSE text)
  string(REGEX MATCH "Copyright \\(c\\) ([^\n]*)" holder "${text}")
  set(holder "${CMAKE_MATCH_1}")
  string(STRIP "${text}" text)
  string(REPLACE "\n\n" "\n.\n" text "${text}")
  string(REPLACE "\n" "\n " text "${text}")
  string(APPEND copyright "\nFiles: third_party/${part}/*\nCopyright: ${holder}\nLicense: MIT-${part}\n ${text}\n")
endforeach()

foreach(component program library development python)
  string(TOUPPER ${component} upper)
  set(name ${CPACK_DEBIAN_${upper}_PACKAGE_NAME})
  set(folder ${CPACK_TEMPORARY_DIRECTORY}/${component}/usr/share)
  file(WRITE ${folder}/doc/${name}/copyright "${copyright}")
  file(WRITE ${folder}/doc/${name}/changelog "${name} (${CPACK_PACKAGE_VERSION}) unstable; urgency=medium

  * See CHANGELOG.md of the sources.

 -- ${CPACK_PACKAGE_CONTACT}  ${date}
")
  file(GLOB texts ${folder}/doc/${name}/changelog ${folder}/man/man1/*.1)
  file(CHMOD ${texts} ${folder}/doc/${name}/copyright PERMISSIONS OWNER_READ OWNER_WRITE GROUP_READ WORLD_READ)
  execute_process(COMMAND gzip -9 -n -f ${texts} COMMAND_ERROR_IS_FATAL ANY)
endforeach()
