// SPDX-License-Identifier: MIT
// The board's descriptors on USB: one serial port, whose serial number is the
// chip's.
#include <string.h>

#include "pico/unique_id.h"
#include "tusb.h"

enum {
    // Raspberry Pi's, and the number that it gives programs on its SDK with a serial
    // port: docs/pico.md.
    VENDOR = 0x2E8A,
    PRODUCT = 0x000A,
    VERSION = 0x0100,
    MILLIAMPERES = 250,
    ENDPOINT_NOTIFY = 0x81,
    ENDPOINT_OUT = 0x02,
    ENDPOINT_IN = 0x82,
    NOTIFY_BYTES = 8,
    DATA_BYTES = 64,
    LENGTH = TUD_CONFIG_DESC_LEN + TUD_CDC_DESC_LEN,
    ENGLISH = 0x0409,
    TEXT_MAX = 32,
};

enum text { TEXT_LANGUAGE, TEXT_MAKER, TEXT_PRODUCT, TEXT_SERIAL, TEXTS };

uint8_t const *tud_descriptor_device_cb(void) {
    static const tusb_desc_device_t device = {
        .bLength = sizeof device,
        .bDescriptorType = TUSB_DESC_DEVICE,
        .bcdUSB = 0x0200,
        .bDeviceClass = TUSB_CLASS_MISC,
        .bDeviceSubClass = MISC_SUBCLASS_COMMON,
        .bDeviceProtocol = MISC_PROTOCOL_IAD,
        .bMaxPacketSize0 = CFG_TUD_ENDPOINT0_SIZE,
        .idVendor = VENDOR,
        .idProduct = PRODUCT,
        .bcdDevice = VERSION,
        .iManufacturer = TEXT_MAKER,
        .iProduct = TEXT_PRODUCT,
        .iSerialNumber = TEXT_SERIAL,
        .bNumConfigurations = 1,
    };
    return (const uint8_t *)&device;
}

uint8_t const *tud_descriptor_configuration_cb(uint8_t index) {
    static const uint8_t configuration[] = {
        TUD_CONFIG_DESCRIPTOR(1, 2, 0, LENGTH, 0, MILLIAMPERES),
        TUD_CDC_DESCRIPTOR(0, 0, ENDPOINT_NOTIFY, NOTIFY_BYTES, ENDPOINT_OUT,
                           ENDPOINT_IN, DATA_BYTES),
    };
    (void)index;
    return configuration;
}

// A string of USB: its length in bytes and its kind, then 16 bits for each letter.
uint16_t const *tud_descriptor_string_cb(uint8_t index, uint16_t language) {
    static uint16_t string[1 + TEXT_MAX];
    char text[TEXT_MAX + 1] = "";
    uint8_t length = 0;
    (void)language;
    switch (index) {
    case TEXT_LANGUAGE:
        string[++length] = ENGLISH;
        break;
    case TEXT_MAKER:
    case TEXT_PRODUCT:
        strcpy(text, "imu-probe");
        break;
    case TEXT_SERIAL:
        pico_get_unique_board_id_string(text, sizeof text);
        break;
    default:
        return NULL;
    }
    for (const char *from = text; *from != '\0'; from++) {
        string[++length] = (uint8_t)*from;
    }
    string[0] = (uint16_t)(TUSB_DESC_STRING << 8 | (2 + 2 * length));
    return string;
}
