// SPDX-License-Identifier: MIT
// Prints the poses of all probes, from C on a microcontroller or a computer. An example
// to read: this project does not build it. It needs zenoh-pico 1.x:
// https://github.com/eclipse-zenoh/zenoh-pico

#include <stdio.h>
#include <zenoh-pico.h>

// The payload is one JSON object:
// {"type":"pose","probe":"...","number":7,"q":[w,x,y,z]...}.
static void take(z_loaned_sample_t *sample, void *context) {
    (void)context;
    z_owned_string_t pose;
    if (z_bytes_to_string(z_sample_payload(sample), &pose) == Z_OK) {
        printf("%.*s\n", (int)z_string_len(z_loan(pose)), z_string_data(z_loan(pose)));
        z_drop(z_move(pose));
    }
}

int main(void) {
    z_owned_config_t config;
    z_config_default(&config);
    zp_config_insert(z_loan_mut(config), Z_CONFIG_MODE_KEY, "client");
    zp_config_insert(z_loan_mut(config), Z_CONFIG_CONNECT_KEY, "tcp/127.0.0.1:7447");
    z_owned_session_t session;
    if (z_open(&session, z_move(config), NULL) != Z_OK) {
        fprintf(stderr, "no imud there; start one with imud run\n");
        return 1;
    }
    zp_start_read_task(z_loan_mut(session), NULL);  // each starts a thread
    zp_start_lease_task(z_loan_mut(session), NULL);
    z_owned_closure_sample_t callback;
    z_closure(&callback, take, NULL, NULL);
    z_view_keyexpr_t key;
    z_view_keyexpr_from_str(&key, "imud/*/pose");
    z_owned_subscriber_t subscriber;
    if (z_declare_subscriber(z_loan(session), &subscriber, z_loan(key),
                             z_move(callback), NULL) != Z_OK) {
        return 1;
    }
    getchar();  // wait for Enter
    z_drop(z_move(subscriber));
    z_drop(z_move(session));
    return 0;
}
