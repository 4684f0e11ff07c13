# SPDX-License-Identifier: MIT
# The module imuprobe for ports that build with CMake (Pico, ESP32):
#     make USER_C_MODULES=.../firmware/micropython/imuprobe/micropython.cmake
get_filename_component(imuprobe_firmware ${CMAKE_CURRENT_LIST_DIR}/../.. ABSOLUTE)
file(GLOB imuprobe_core ${imuprobe_firmware}/core/*/*.c)

add_library(usermod_imuprobe INTERFACE)
target_sources(usermod_imuprobe INTERFACE
    ${CMAKE_CURRENT_LIST_DIR}/module.c
    ${CMAKE_CURRENT_LIST_DIR}/ports.c
    ${imuprobe_core}
    ${imuprobe_firmware}/generic/identity.c
)
target_include_directories(usermod_imuprobe INTERFACE ${imuprobe_firmware})
target_link_libraries(usermod INTERFACE usermod_imuprobe)
