# wraptor::wraptor is the shared library, wraptor::static the static one.
get_filename_component(_wraptor "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
foreach(_kind wraptor static)
  if(NOT TARGET wraptor::${_kind})
    if(_kind STREQUAL "static")
      add_library(wraptor::static STATIC IMPORTED)
      set_target_properties(wraptor::static PROPERTIES
        IMPORTED_LOCATION "${_wraptor}/lib/libwraptor.a"
        INTERFACE_LINK_LIBRARIES "gcc_s;util;rt;pthread;m;dl;c")
    else()
      add_library(wraptor::wraptor SHARED IMPORTED)
      set_target_properties(wraptor::wraptor PROPERTIES
        IMPORTED_LOCATION "${_wraptor}/lib/libwraptor.so"
        IMPORTED_SONAME "libwraptor.so.0")
    endif()
    set_target_properties(wraptor::${_kind} PROPERTIES
      INTERFACE_INCLUDE_DIRECTORIES "${_wraptor}/include")
  endif()
endforeach()
