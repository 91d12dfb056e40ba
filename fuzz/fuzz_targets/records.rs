#![no_main]

cloudparity_fuzz::target!("records", Json);
