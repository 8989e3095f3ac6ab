# modalctl loads a library at the first call into it; see lazy.h.  Those of no weight are linked: Lua, cJSON, zlib, the C library's.
# libopenblas comes before what stands on BLAS and LAPACK, as it does for modald-worker: theirs are its functions.
if(CMAKE_SYSTEM_PROCESSOR STREQUAL x86_64)
  enable_language(ASM)
  set(openblas ${LAPACKE_LINK_LIBRARIES})
  list(FILTER openblas INCLUDE REGEX openblas)
  set(lapacke ${LAPACKE_LINK_LIBRARIES})
  list(FILTER lapacke INCLUDE REGEX lapacke)
  set(lazy_calls ${CMAKE_BINARY_DIR}/clients/ctl/lazy_calls.S)
  file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/clients/ctl)
  foreach(archive ctl modald_client modald_stream_static job store wire modal)
    list(APPEND lazy_archives $<TARGET_FILE:${archive}>)
  endforeach()
  add_custom_command(OUTPUT ${lazy_calls}
    COMMAND ${CMAKE_CURRENT_LIST_DIR}/calls ${openblas},${lapacke} ${openblas},${UMFPACK} ${openblas},${CHOLMOD} ${FFTW_LINK_LIBRARIES} ${HDF5_LINK_LIBRARIES}
      ${SQLITE_LINK_LIBRARIES} ${ZMQ_LINK_LIBRARIES} ${CRYPTO_LINK_LIBRARIES} ${SNDFILE_LINK_LIBRARIES} -- ${lazy_archives} > ${lazy_calls}
    DEPENDS ${CMAKE_CURRENT_LIST_DIR}/calls ${lazy_archives} VERBATIM)
  set_source_files_properties(${lazy_calls} PROPERTIES OBJECT_DEPENDS ${CMAKE_CURRENT_LIST_DIR}/lazy.S
    INCLUDE_DIRECTORIES ${CMAKE_SOURCE_DIR}/clients)
  target_sources(modalctl PRIVATE ${lazy_calls})
  target_link_options(modalctl PRIVATE "-Wl,--export-dynamic-symbol=H5*_g")     # HDF5's objects: one for it and the program

  foreach(guarded connect recv crypto_box_open_afternm LAPACKE_xerbla)          # the program's for libzmq and LAPACKE too, which are not linked
    target_link_options(modalctl PRIVATE -Wl,--export-dynamic-symbol=${guarded})
  endforeach()

  # For dpkg-shlibdeps: what modalctl would be linked with.
  add_library(lazy_needs MODULE ${lazy_calls})
  set_target_properties(lazy_needs PROPERTIES LINKER_LANGUAGE C PREFIX "")
  target_compile_definitions(lazy_needs PRIVATE LAZY_NEEDS)
  target_link_libraries(lazy_needs PRIVATE house PkgConfig::LAPACKE ${UMFPACK} ${CHOLMOD} PkgConfig::FFTW PkgConfig::HDF5 PkgConfig::SQLITE
    PkgConfig::ZMQ PkgConfig::CRYPTO PkgConfig::SNDFILE)
endif()
