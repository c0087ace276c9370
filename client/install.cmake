# `cmake --install`: the commands, the wire contract, and the client library as the CMake package `candela`.
include(CMakePackageConfigHelpers)

# The public headers. Here their includes name files from the top of the tree; installed, from include/.
set(public ${CMAKE_BINARY_DIR}/install/candela)
foreach(header client/connection.h client/panorama.h client/render_result.h client/retry.h client/security.h client/session.h proto/candela/v1/limits.h
        server/base/pixel_memory.h)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/${header})
  file(READ ${CMAKE_SOURCE_DIR}/${header} text)
  string(REPLACE "#include \"client/" "#include \"candela/" text "${text}")
  string(REPLACE "#include \"proto/candela/" "#include \"candela/" text "${text}")
  string(REPLACE "#include \"server/base/" "#include \"candela/" text "${text}")
  string(REGEX REPLACE "^(client|proto/candela|server/base)/" "" name ${header})
  file(CONFIGURE OUTPUT ${public}/${name} CONTENT "${text}" @ONLY)
endforeach()
install(DIRECTORY ${public} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(FILES ${CMAKE_BINARY_DIR}/generated/candela/v1/render.pb.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/candela/v1)
install(FILES ${CMAKE_SOURCE_DIR}/proto/candela/v1/render.proto DESTINATION ${CMAKE_INSTALL_DATADIR}/candela/v1)

install(TARGETS candela candelad)
set_target_properties(candela_client_connection PROPERTIES EXPORT_NAME client)
install(TARGETS candela_client_connection candela_client_base candela_words candela_environment_id candela_wire candela_proto candela_messages EXPORT candelaTargets)
set(package ${CMAKE_INSTALL_LIBDIR}/cmake/candela)
install(EXPORT candelaTargets NAMESPACE candela:: DESTINATION ${package})
configure_package_config_file(client/candelaConfig.cmake.in ${CMAKE_BINARY_DIR}/install/candelaConfig.cmake
                              INSTALL_DESTINATION ${package})
write_basic_package_version_file(${CMAKE_BINARY_DIR}/install/candelaConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_BINARY_DIR}/install/candelaConfig.cmake ${CMAKE_BINARY_DIR}/install/candelaConfigVersion.cmake
        DESTINATION ${package})
