// SPDX-License-Identifier: MIT
// Sensor and memory of a board with PORTS_FIXED, for ports.h.
#ifndef PARTS_H
#define PARTS_H

#include "core/storage/memory.h"
#ifdef SAMPLING_TWO_BURSTS
#include "core/drivers/adafruit_4517.h"

extern struct joined chip_pair;
void chip_pair_begin(void *state);
static const IN_FLASH struct sensor_driver fixed_sensor =
    JOINED_DRIVER(&chip_pair, chip_pair_begin);
#else
#include "core/drivers/mpu9250.h"

extern struct mpu9250 board_chip;
static const IN_FLASH struct sensor_driver fixed_sensor = MPU9250_DRIVER(&board_chip);
#endif

enum bus_result sampling_read(void *port, uint8_t address, uint8_t reg, uint8_t *data,
                              uint8_t length);
enum bus_result sampling_write(void *port, uint8_t address, uint8_t reg,
                               const uint8_t *data, uint8_t length);
static const IN_FLASH struct bus_device fixed_bus = {sampling_read, sampling_write, 0};

uint8_t eeprom_read(void *port, uint16_t offset);
void eeprom_write(void *port, uint16_t offset, uint8_t value);
bool eeprom_is_ready(void *port);
static const IN_FLASH struct memory fixed_memory = {eeprom_read, eeprom_write,
                                                    eeprom_is_ready, 0};

#endif
