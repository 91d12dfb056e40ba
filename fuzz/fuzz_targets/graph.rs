#![no_main]

cloudparity_fuzz::target!("graph", Json);
